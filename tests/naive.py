"""Slow, obvious references that the fast code must equal."""

import math

import numpy as np

# --- Open-end soft-DTW: Algorithm 1 and Eq. 3 of the paper, with the resolutions of the project ---


def naive_phase(query, reference, gamma=0.0, distance="wp", window=10):
    """Phases (m,): lines 7 and 8 of Algorithm 1, with j over [1, n]; ties go to the lowest j."""
    R = naive_accumulated_cost(query, reference, gamma, distance, window)
    m, n = len(query), len(reference)
    phases = []
    for i in range(1, m + 1):
        best = 1
        for j in range(2, n + 1):
            if R[i, j] < R[i, best]:
                best = j
        phases.append((best - 1) / (n - 1))
    return np.array(phases)


def naive_accumulated_cost(query, reference, gamma=0.0, distance="wp", window=10):
    """R (m + 1, n + 1): lines 1 to 6 of Algorithm 1."""
    p, q = np.asarray(query, dtype=float), np.asarray(reference, dtype=float)
    m, n = len(p), len(q)
    D = np.empty((m, n))
    for i in range(m):
        for j in range(n):
            D[i, j] = naive_distance(p, q, i, j, distance, window)
    R = np.full((m + 1, n + 1), math.inf)
    R[0, 0] = 0.0
    for i in range(1, m + 1):
        for j in range(1, n + 1):
            R[i, j] = D[i - 1, j - 1] + naive_soft_min([R[i - 1, j], R[i, j - 1], R[i - 1, j - 1]], gamma)
    return R


def naive_soft_min(values, gamma):
    """min^gamma of Soft-DTW: -gamma log sum exp(-v / gamma); the hard minimum for gamma = 0."""
    low = min(values)
    if gamma == 0.0 or low == math.inf:
        return low
    return low - gamma * math.log(sum(math.exp(-(value - low) / gamma) for value in values))


def naive_distance(p, q, i, j, distance, window):
    """delta(p_i, q_j)."""
    if distance == "wp":
        total = sum(1.0 - naive_correlation(p, q, i, j, axis, window) for axis in range(p.shape[1]))
        return round(total * 2**40) / 2**40  # so that rounding doesn't break ties
    square = sum((p[i, axis] - q[j, axis]) ** 2 for axis in range(p.shape[1]))
    return {"sqeuclidean": square, "euclidean": math.sqrt(square)}[distance]


def naive_correlation(p, q, i, j, axis, window):
    """The fraction in Eq. 3, with windows cut to the samples that exist; 0 where it is undefined."""
    k = min(window, i + 1, j + 1)
    a, b = p[i - k + 1 : i + 1, axis], q[j - k + 1 : j + 1, axis]
    if k < 2 or all(a == a[0]) or all(b == b[0]):
        return 0.0
    a, b = a - np.mean(a), b - np.mean(b)
    return np.mean(a * b) / math.sqrt(np.mean(a * a) * np.mean(b * b))


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
