"""PaceAssemblyEnv: the diagram as a Gymnasium environment, one step per decision."""

from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np

from pace_drake.diagram import Assembly
from pace_drake.scenario import Scenario, load_scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.task import Episode

#: [s] bound of the elapsed time in the observation space; longer waits are clipped to it.
MAX_ELAPSED = 3600.0


class PaceAssemblyEnv(gym.Env):
    """Decide, between two of the robot's own tasks, whether to go and assist the person.

    ## Description
    The POMDP of the PACE paper (Sec. IV-B), as resolved in docs/departures.md, simulated by the project's Drake
    diagram at the task level. A step lasts from one decision to the next: one robot task, or a whole assistance
    (prepare, wait, joint action, homing). Steps differ in duration, so train without discount (gamma = 1).

    ## Action Space
    `Discrete(2)`: 0 go on with the next robot task, 1 assist in the next joint action.

    ## Observation Space
    `Box(4,)` float32, the paper's O(s):

    | num | observation | min | max | unit |
    |---|---|---|---|---|
    | 0 | last robot task i | 1 | M | index |
    | 1 | current human action j; a joint action means that the person waits | 1 | N | index |
    | 2 | time since that action (or waiting) began | 0 | 3600 | s |
    | 3 | estimated phase of that action | 0 | 1 | - |

    ## Rewards
    Eq. 4: minus the robot's idle time, minus lambda times the human's, since the decision before [s]. The sum over an
    episode is minus its cost.

    ## Starting State
    Durations and demonstrations are drawn; the first decision is asked for at t = 0 with the last robot task done.

    ## Episode End
    Terminated when the robot is home after the last joint action; truncated after the scenario's `max_decisions`.

    ## Info
    `time` [s] at which the observation was made, `duration` [s] of the step, `robot_idle` and `human_idle` (L,) [s] up
    to now, `cost` [s] up to now.

    ## Arguments
    * `scenario`: name, .yaml file or a `Scenario`; default `ikea_chair`.
    * `split`: which trials are played (`train`, `validation`, `all`); None takes the scenario's.

    `reset(options={"episode": Episode})` plays a given episode instead of drawing one.

    ## Version History
    * v0: first release.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        scenario: str | Scenario = "ikea_chair",
        split: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = render_mode
        loaded = load_scenario(scenario) if isinstance(scenario, str) else deepcopy(scenario)
        if split is not None:
            loaded.human.split = split
            loaded.validate()
        self.scenario = loaded
        # Built once: Drake never frees Python systems, and a reset context costs far less.
        self.simulation = Simulation(Assembly(loaded))
        task = loaded.task
        self.action_space = gym.spaces.Discrete(2)
        self.observation_space = gym.spaces.Box(
            low=np.array([1, 1, 0, 0], dtype=np.float32),
            high=np.array([task.num_robot_tasks, task.num_human_actions, MAX_ELAPSED, 1], dtype=np.float32),
        )
        self._cost = self._time = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Draws and starts an episode; see the class."""
        super().reset(seed=seed)
        episode = (options or {}).get("episode")
        if episode is None:
            episode = self.simulation.sample_episode(self.np_random)
        elif not isinstance(episode, Episode):
            raise TypeError("options['episode'] must be a pace_drake.task.Episode")
        self.simulation.reset(episode)
        stop = self.simulation.advance()
        assert stop == Stop.DECISION
        self._cost = self._time = 0.0
        observation, _, info = self._observe()
        return observation, info

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Carries the decision out and advances to the next one; see the class."""
        self.simulation.decide(int(action))
        stop = self.simulation.advance()
        observation, reward, info = self._observe()
        terminated = stop == Stop.FINISHED
        truncated = not terminated and self.simulation.num_decisions >= self.scenario.max_decisions
        return observation, reward, terminated, truncated, info

    def _observe(self) -> tuple[np.ndarray, float, dict[str, Any]]:
        simulation = self.simulation
        observation = simulation.output("observation").astype(np.float32)
        observation[2] = min(observation[2], MAX_ELAPSED)
        cost, time = float(simulation.output("cost")[0]), simulation.time
        reward, duration = self._cost - cost, time - self._time
        self._cost, self._time = cost, time
        info = {
            "time": time,
            "duration": duration,
            "robot_idle": simulation.output("robot_idle").copy(),
            "human_idle": simulation.output("human_idle").copy(),
            "cost": cost,
        }
        return observation, reward, info
