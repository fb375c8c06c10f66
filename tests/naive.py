"""Slow, obvious references that the fast code must equal."""

import math

import numpy as np

# --- Open-end soft-DTW: Algorithm 1 and Eq. 3 of the paper, with the resolutions of the project ---


def naive_phase(
    query, reference, gamma=0.0, distance="wp", window=10, steps="symmetric1", normalization="none", **more
):
    """Phases (m,): lines 7 and 8 of Algorithm 1, with j over [1, n]; ties go to the lowest j."""
    R = naive_accumulated_cost(query, reference, gamma, distance, window, steps, **more)
    m, n = len(query), len(reference)
    phases = []
    for i in range(1, m + 1):
        costs = [R[i, j] / naive_length(i, j, steps, normalization) for j in range(1, n + 1)]
        phases.append(costs.index(min(costs)) / (n - 1))
    return np.array(phases)


def naive_length(i, j, steps, normalization):
    """By what R[i, j] is divided, i and j from 1."""
    return {"none": 1, "max": max(i, j), "steps": i if steps == "asymmetric" else i + j}[normalization]


def naive_accumulated_cost(query, reference, gamma=0.0, distance="wp", window=10, steps="symmetric1", pooled=False):
    """R (m + 1, n + 1): lines 1 to 6 of Algorithm 1; the window in samples."""
    p, q = np.asarray(query, dtype=float), np.asarray(reference, dtype=float)
    m, n = len(p), len(q)
    if distance == "derivative":
        p, q, distance = naive_late_derivative(p), naive_late_derivative(q), "euclidean"
    R = np.full((m + 1, n + 1), math.inf)
    R[0, 0] = 0.0
    for i in range(1, m + 1):
        for j in range(1, n + 1):
            d = naive_distance(p, q, i - 1, j - 1, distance, window, pooled)
            above, left, diagonal = R[i - 1, j], R[i, j - 1], R[i - 1, j - 1]
            if steps == "symmetric2" and (i, j) != (1, 1):
                diagonal += d
            elif steps == "asymmetric":
                left = R[i - 1, j - 2] if j > 2 else math.inf
            R[i, j] = d + naive_soft_min([above, left, diagonal], gamma)
    return R


def naive_late_derivative(x):
    """At each sample the derivative (Keogh and Pazzani, 2001) at the one before it, at rest before the first."""
    derivative = []
    for i in range(len(x)):
        older, last, this = x[max(i - 2, 0)], x[max(i - 1, 0)], x[i]
        derivative.append(((last - older) + (this - older) / 2) / 2)
    return np.array(derivative)


def naive_soft_min(values, gamma):
    """min^gamma of Soft-DTW: -gamma log sum exp(-v / gamma); the hard minimum for gamma = 0."""
    low = min(values)
    if gamma == 0.0 or low == math.inf:
        return low
    return low - gamma * math.log(sum(math.exp(-(value - low) / gamma) for value in values))


def naive_distance(p, q, i, j, distance, window, pooled=False):
    """delta(p_i, q_j)."""
    if distance == "wp":
        axes = range(p.shape[1])
        groups = [list(axes)] if pooled else [[axis] for axis in axes]
        total = sum(1.0 - naive_correlation(p, q, i, j, group, window) for group in groups)
        return round(total * 2**40) / 2**40  # so that rounding doesn't break ties
    square = sum((p[i, axis] - q[j, axis]) ** 2 for axis in range(p.shape[1]))
    return {"sqeuclidean": square, "euclidean": math.sqrt(square)}[distance]


def naive_correlation(p, q, i, j, axes, window):
    """The fraction in Eq. 3, sums over axes, with windows cut to the samples that exist; 0 where it is undefined."""
    k = min(window, i + 1, j + 1)
    a, b = p[i - k + 1 : i + 1, axes], q[j - k + 1 : j + 1, axes]
    if k < 2 or (a == a[0]).all() or (b == b[0]).all():
        return 0.0
    a, b = a - np.mean(a, axis=0), b - np.mean(b, axis=0)
    a, b = a / np.abs(a).max(), b / np.abs(b).max()  # squares of tiny or huge samples are no numbers
    return np.sum(a * b) / math.sqrt(np.sum(a * a) * np.sum(b * b))


def naive_episode(task, episode, decide, max_decisions=200):
    """The POMDP of the paper (Sec. IV-C) by the closed forms of paper/notes.md, without any event queue.

    Args:
        task, episode: a pace_drake.task.Task and the durations drawn for it.
        decide: called as decide(decision_number) -> 0 or 1.

    Returns:
        (robot_idle (L,), human_idle (L,), times of the decisions, whether it finished).
    """
    joints, alpha = task.num_joint_actions, task.human_index_of_joint
    robot_idle, human_idle = np.zeros(joints), np.zeros(joints)

    def segment(joint):  # time that the human works between joint actions joint - 1 and joint
        first = alpha[joint - 2] if joint > 1 else 0
        return sum(episode.human[first : alpha[joint - 1] - 1])

    time, sequence, i, joint, times = 0.0, 0, task.num_robot_tasks, 1, []
    remaining = segment(1)
    while len(times) < max_decisions:
        assist = decide(len(times))
        times.append(time)
        if assist == 0:
            i = i % task.num_robot_tasks + 1
            sequence += 1
            duration = episode.robot[(sequence - 1) % len(episode.robot), i - 1]
            human_idle[joint - 1] += max(0.0, duration - max(remaining, 0.0))
            remaining -= duration
            time += duration
            continue
        prepare, home = episode.preparation[joint - 1], episode.homing[joint - 1]
        waited = max(0.0, remaining - prepare)
        robot_idle[joint - 1] += waited
        human_idle[joint - 1] += max(0.0, prepare - max(remaining, 0.0))
        time += prepare + waited + episode.human[alpha[joint - 1] - 1] + home
        sequence += 3
        joint += 1
        if joint > joints:
            return robot_idle, human_idle, times, True
        remaining = segment(joint) - home
        human_idle[joint - 1] += max(0.0, -remaining)
    return robot_idle, human_idle, times, False


def naive_duration_posterior(z, elapsed, calibration, num=400_001):
    """(T (num,) [s], its posterior (num,)) of an action that goes on, by Bayes' rule on a fine grid of log T."""
    c = calibration

    def curve(values):
        return np.interp(z, np.linspace(0, 1, len(values)), values)

    from_mean = np.linspace(-30.0, 30.0, num) * c.duration_log_std
    log_T = c.duration_log_mean + from_mean
    log_p = -0.5 * (from_mean / c.duration_log_std) ** 2
    if elapsed > 0.0:
        expected = log_T + curve(c.offset) + curve(c.slope) * from_mean
        log_p -= 0.5 * ((math.log(elapsed / z) - expected) / curve(c.std)) ** 2
        log_p[np.exp(log_T) <= elapsed] = -math.inf
    p = np.exp(log_p - log_p.max())
    return np.exp(log_T), p / p.sum()


def naive_spread(phases, durations, period):
    """``alignments.spread``, one true phase and one person at a time."""
    levels = [0.3 + 0.05 * k for k in range(14)]

    def at(one, seconds, level):
        """The phase at a true phase, linear between samples."""
        place = level * seconds / period
        before = min(int(place), len(one) - 2)
        return one[before] + (place - before) * (one[before + 1] - one[before])

    table = [[at(one, seconds, level) for one, seconds in zip(phases, durations, strict=True)] for level in levels]
    means = [sum(row) / len(row) for row in table]
    total = 0.0
    for k, row in enumerate(table):
        lower, upper = max(k - 1, 0), min(k + 1, len(levels) - 1)
        slope = max((means[upper] - means[lower]) / (levels[upper] - levels[lower]), 0.2)
        variance = sum((value - means[k]) ** 2 for value in row) / len(row)
        total += variance / slope**2
    return (total / len(levels)) ** 0.5
