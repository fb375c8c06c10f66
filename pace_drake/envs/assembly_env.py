"""PaceAssemblyEnv: the diagram as a Gymnasium environment, one step per decision."""

from math import inf
from typing import Any, Literal

import gymnasium as gym
import numpy as np

from pace_drake.diagram import Assembly, make_plant_assembly
from pace_drake.envs.space import adapted, observation_space
from pace_drake.errors import InputError
from pace_drake.evaluate.episode import SAMPLE_PERIOD, write_phase
from pace_drake.evaluate.event_log import COLUMNS, EventRecorder, event_row
from pace_drake.evaluate.timeline import timeline_image
from pace_drake.scenario import Scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.task import Episode

LEVELS = ("task", "plant")


class PaceAssemblyEnv(gym.Env):
    """Decide, between two of the robot's own tasks, whether to go and assist the person.

    ## Description
    The POMDP of the PACE paper (Sec. IV-B), as resolved in docs/departures.md, simulated by the project's Drake
    diagram. A step lasts from one decision to the next: one robot task, or a whole assistance (prepare, wait, joint
    action, homing). Steps differ in duration, so train without discount (gamma = 1).

    ## Action Space
    `Discrete(2)`: 0 go on with the next robot task, 1 assist in the next joint action.

    ## Observation Space
    `Box(D,)` float32; of these, the observation set `none` sees the first 3, `paper` the first 4 (the paper's O(s)),
    `fused` the first 6, `history` all 7:

    | num | observation | min | max | unit |
    |---|---|---|---|---|
    | 0 | last robot task i | 1 | M | index |
    | 1 | current human action j; a joint action means that the person waits | 1 | N | index |
    | 2 | time since that action (or waiting) began | 0 | 3600 | s |
    | 3 | estimated phase of that action; in `fused` and `history` the phase filter's mean | 0 | 1 | - |
    | 4 | standard deviation of the phase | 0 | 1 | - |
    | 5 | expected time to the end of that action; 0 while the person waits | 0 | 3600 | s |
    | 6 | this person's pace: mean of finished actions' durations over their means; 1 at first | 0 | 100 | - |

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

    ## Rendering
    `human` prints a line for each decision and the end; `rgb_array` gives the timeline so far, (height, width, 3).

    ## Arguments
    * `scenario`: name, .yaml file or a `Scenario`; default `ikea_chair`.
    * `level`: `task` (durations only) or `plant` (the Panda in its workcell, thousands of times slower).
    * `observation`: an observation set; None takes the scenario's.
    * `split`: which trials are played (`train`, `validation`, `unseen`, `all`); None takes the scenario's.

    `reset(options={"episode": Episode})` plays a given episode instead of drawing one.

    ## Version History
    * v0: first release.
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 1}  # noqa: RUF012 - as Gymnasium declares it

    def __init__(
        self,
        scenario: str | Scenario = "ikea_chair",
        level: Literal["task", "plant"] = "task",
        observation: str | None = None,
        split: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        if level not in LEVELS:
            raise InputError(f"level must be one of {', '.join(LEVELS)}, is {level!r}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode must be one of human, rgb_array or None, is {render_mode!r}")
        self.render_mode = render_mode
        self.scenario = loaded = adapted(scenario, observation, split)
        # Built once: Drake never frees Python systems, and a reset context costs far less.
        self.simulation = Simulation(Assembly(loaded) if level == "task" else make_plant_assembly(loaded))
        self.action_space = gym.spaces.Discrete(2)
        self.observation_space = space = observation_space(loaded)
        self._low, self._high = space.low, space.high
        self._cost = self._time = 0.0
        self._events: list[dict[str, str]] = []
        # Looked at more often where the phase is drawn.
        self._period = SAMPLE_PERIOD if render_mode == "rgb_array" else inf

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
        if self.render_mode == "rgb_array":
            self._events = []
            self.simulation.listeners = (EventRecorder(self._write),)
        layout = None
        if self.simulation.assembly.station is not None:
            # Of a generator of its own, so that the next episode's people are those of the task level.
            layout = self.simulation.sample_layout(self.np_random.spawn(1)[0])
        self.simulation.reset(episode, layout)
        stop = self._advance()
        assert stop == Stop.DECISION
        self._cost = self._time = 0.0
        observation, _, info = self._observe()
        if self.render_mode == "human":
            print("a new episode")
            self._print(observation, info)
        return observation, info

    def step(self, action: int) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Carries the decision out and advances to the next one; see the class."""
        if action not in (0, 1):
            raise ValueError(f"an action is 0 or 1, not {action!r}")
        self.simulation.decide(int(action))
        stop = self._advance()
        observation, reward, info = self._observe()
        terminated = stop == Stop.FINISHED
        truncated = not terminated and self.simulation.num_decisions >= self.scenario.max_decisions
        if self.render_mode == "human":
            print(f"{'assist' if action else 'go on':>6}: {info['duration']:6.2f} s, reward {reward:7.2f}")
            if terminated or truncated:
                print(f"{'finished' if terminated else 'truncated'}: cost {info['cost']:.2f} s")
            else:
                self._print(observation, info)
        return observation, reward, terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """See the class; in mode ``human`` everything is printed as it happens."""
        if self.render_mode != "rgb_array":
            return None
        title = f"{self.scenario.name}: {self.simulation.assembly.people.description}"
        return timeline_image(self._events, self.scenario.task, title)

    def _advance(self) -> Stop:
        while (stop := self.simulation.advance(self.simulation.time + self._period)) == Stop.BOUNDARY:
            write_phase(self.simulation, self._write)
        return stop

    def _write(self, time: float, kind: str, **values: Any) -> None:
        # As a file of events would be read.
        row = {key: str(value) for key, value in event_row(time, kind, **values).items()}
        self._events.append(dict.fromkeys(COLUMNS, "") | row)

    def _print(self, observation: np.ndarray, info: dict[str, Any]) -> None:
        task = self.scenario.task
        action = task.human_actions[int(observation[1]) - 1]
        what = f"waits for {action.name}" if action.joint else action.name
        phase = f", phase {observation[3]:.2f}" if len(observation) > 3 else ""
        print(f"{info['time']:7.2f} s: {what} for {observation[2]:.1f} s{phase}; assist?")

    def _observe(self) -> tuple[np.ndarray, float, dict[str, Any]]:
        simulation = self.simulation
        observation = np.clip(simulation.output("observation").astype(np.float32), self._low, self._high)
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
