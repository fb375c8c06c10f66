"""The least cost of an episode for a robot that knows all durations beforehand: the physical limit of any policy."""

import numpy as np
from numba import njit

from pace_drake.scenario import Scenario
from pace_drake.task import NUM_ROBOT_DRAWS, Episode


def clairvoyant_cost(scenario: Scenario, episode: Episode) -> float:
    """The least cost [s] of one episode over all words of decisions.

    Exact: a search over the number of robot tasks before each assistance, cut off where a bound shows that more cannot
    pay. Of the person's waiting only that for the assistances counts, as in Eq. 1; the robot waits for ever.

    Args:
        scenario: gives lambda, the joint actions, and whether the first decision is at the start.
        episode: all durations.
    """
    task = scenario.task
    first = 0 if scenario.decide_at_start else 1
    time = 0.0 if scenario.decide_at_start else float(episode.robot[0, 0])
    return float(
        _least(
            0, time, first, task.num_robot_tasks if scenario.decide_at_start else 1, 0.0, np.inf,
            np.array(task.human_index_of_joint), episode.human, episode.robot, episode.preparation, episode.homing,
            task.human_idle_weight,
        )
    )  # fmt: skip


@njit(cache=True)
def _least(
    joint: int,
    time: float,
    number: int,
    robot_task: int,
    start: float,
    limit: float,
    alpha: np.ndarray,
    human: np.ndarray,
    robot: np.ndarray,
    preparation: np.ndarray,
    homing: np.ndarray,
    weight: float,
) -> float:
    """The least cost from a decision at ``time`` on, the person having begun to act at ``start``; ``limit`` if more."""
    if joint == len(alpha):
        return 0.0
    first = alpha[joint - 1] if joint > 0 else 0
    ready = start
    for k in range(first, alpha[joint] - 1):
        ready += human[k]
    best = limit
    while True:
        prepared = time + preparation[joint]
        begun = max(prepared, ready)
        late = weight * max(0.0, prepared - ready)
        if late >= best:  # and every robot task more makes it later
            return best
        cost = begun - prepared + late
        if cost < best:
            ended = begun + human[alpha[joint] - 1]
            rest = _least(
                joint + 1, ended + homing[joint], number + 3, robot_task, ended, best - cost, alpha, human, robot,
                preparation, homing, weight,
            )  # fmt: skip
            best = min(best, cost + rest)
        robot_task = robot_task % robot.shape[1] + 1
        time += robot[number % NUM_ROBOT_DRAWS, robot_task - 1]
        number += 1
