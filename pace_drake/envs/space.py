"""What environments share: the scenario that they are asked for, and the space of its observations."""

from copy import deepcopy

import gymnasium as gym
import numpy as np

from pace_drake.observation import MAX_TIME, OBSERVATION, OBSERVATION_SETS
from pace_drake.scenario import Scenario, load_scenario

#: A person is not taken to be slower, on average, than this many times the mean.
MAX_PACE = 100.0


def adapted(scenario: str | Scenario, observation: str | None, split: str | None) -> Scenario:
    """The scenario of an environment: a copy, with what the environment is asked to do otherwise.

    Args:
        scenario: name, .yaml file or a ``Scenario``.
        observation: an observation set; None takes the scenario's.
        split: which trials are played; None takes the scenario's.

    Raises:
        InputError: no such scenario, observation set or split.
    """
    loaded = load_scenario(scenario) if isinstance(scenario, str) else deepcopy(scenario)
    if split is not None:
        loaded.human.split = split
    if observation is not None:
        loaded.observation = observation
    loaded.validate()
    return loaded


def observation_space(scenario: Scenario) -> gym.spaces.Box:
    """Bounds of the scenario's observation set, in the units of ``pace_drake.observation``."""
    task = scenario.task
    bounds = {
        "robot_task": (1, task.num_robot_tasks),
        "human_action": (1, task.num_human_actions),
        "human_elapsed": (0, MAX_TIME),
        "phase": (0, 1),
        "phase_std": (0, 1),
        "remaining_time": (0, MAX_TIME),
        "pace": (0, MAX_PACE),
    }
    names = OBSERVATION[: OBSERVATION_SETS[scenario.observation]]
    low, high = np.array([bounds[name] for name in names], dtype=np.float32).T
    return gym.spaces.Box(low, high)
