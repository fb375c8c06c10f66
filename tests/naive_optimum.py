"""The optimum without phase by enumeration: small tasks with few possible durations, every belief written out."""

from functools import cache
from itertools import product


def naive_optimum(human, robot, preparation, homing, alpha, weight):
    """Least expected cost of all policies that see the last robot task, the action and the time since it began.

    Args:
        human: per action {duration: probability}, joint actions included (theirs do not matter).
        robot: per robot task {duration: probability}; preparation, homing: per joint action likewise.
        alpha: 1-based indices of the joint actions.
        weight: lambda.

    All durations are whole numbers > 0; the first decision is at t = 0 with the last robot task done.
    """

    def segment(joint):
        first = alpha[joint - 1] if joint else 0
        return tuple(range(first, alpha[joint] - 1))

    @cache
    def waiting(joint, task):
        return weight * sum(p * t for t, p in preparation[joint].items()) + after(joint + 1, task)

    @cache
    def after(joint, task):
        """From the start of a segment: the robot homes (or is free at once, at the very beginning)."""
        if joint == len(alpha):
            return 0.0
        begin = {0: 1.0} if joint == 0 else homing[joint - 1]
        return sum(p * moved(joint, 0, 0, busy, task) for busy, p in begin.items())

    @cache
    def moved(joint, position, elapsed, busy, task):
        """The person is in an action of the segment for ``elapsed``; the next decision comes ``busy`` later."""
        actions = segment(joint)
        if position == len(actions):  # waits until the decision
            return weight * busy + waiting(joint, task)
        possible = {t: p for t, p in human[actions[position]].items() if t > elapsed}
        total, value, goes_on = sum(possible.values()), 0.0, 0.0
        for t, p in possible.items():
            if t <= elapsed + busy:  # at the very end the next action has begun
                value += p / total * moved(joint, position + 1, 0, elapsed + busy - t, task)
            else:
                goes_on += p / total
        if goes_on:
            value += goes_on * decide(joint, position, elapsed + busy, task)
        return value

    @cache
    def decide(joint, position, elapsed, task):
        actions = segment(joint)
        if position == len(actions):
            return waiting(joint, task)
        following = task % len(robot) + 1
        go_on = sum(p * moved(joint, position, elapsed, r, following) for r, p in robot[following - 1].items())
        possible = {t - elapsed: p for t, p in human[actions[position]].items() if t > elapsed}
        total, assist = sum(possible.values()), after(joint + 1, task)
        rest = [human[k].items() for k in actions[position + 1 :]]
        for (now, p), (ready, q), *others in product(possible.items(), preparation[joint].items(), *rest):
            left, chance = now, p / total * q
            for t, r in others:
                left, chance = left + t, chance * r
            assist += chance * (max(left - ready, 0) + weight * max(ready - left, 0))
        return min(go_on, assist)

    return after(0, len(robot))
