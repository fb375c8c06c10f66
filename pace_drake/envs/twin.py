"""AssemblyTwin: many episodes of the task level at once, compiled, without Drake.

It runs the same compiled chart as the diagram (``CompiledChart.react_in_place``), and the event order of
``pace_drake.simulation.Simulation``: at an event the chart reacts to rest, then the robot, the person and the idle
meter update, then time goes on to the next event. A test holds both equal, decision by decision.

Phases are exact. The estimator takes one sample of the hand per tick of the tracker, and the samples depend on the
demonstration and on the drawn duration of the action alone; so the phases of a (demonstration, duration) pair are
computed once, by the estimator of the scenario itself, and looked up by the number of ticks since the action began. A
``Pool`` holds such pairs; episodes are put together from them. The phase of another duration is never taken instead.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange

from pace_drake.errors import InputError
from pace_drake.people import People
from pace_drake.scenario import Scenario
from pace_drake.statechart import CompiledChart, compile_chart, load_chart
from pace_drake.statechart.compile import MAX_CHAIN
from pace_drake.task import NUM_ROBOT_DRAWS, ActionKind, Episode

DECISION, FINISHED, NO_EVENT, NO_REST = 1, 2, 3, 4
#: From so many environments on, threads share the work.
_PARALLEL = 32

_NEEDED = {
    "inputs": ("a", "done", "rb", "hj", "nj"),
    "outputs": ("kind", "index", "number", "joint_ready", "robot_waiting"),
    "variables": ("i",),
}


@dataclass(frozen=True)
class Phases:
    """Phases of several actions, end to end.

    Attributes:
        values: phases after the first sample, the second, ... of each action.
        start, length: where those of an action are.
    """

    values: np.ndarray
    start: np.ndarray
    length: np.ndarray


@dataclass(frozen=True)
class Pool:
    """Drawn durations of which episodes are put together.

    Each human action, the robot's tasks, the preparations and the homings of an episode are those of any of K drawn
    episodes, so that K of them make K to the power of N + 3.

    Attributes:
        human: (N, K) [s]; demonstration: (N, K), -1 for joint actions; phases: of each action and draw.
        robot: (K, NUM_ROBOT_DRAWS, M), preparation: (K, L), homing: (K, L) [s].
    """

    human: np.ndarray
    demonstration: np.ndarray
    phases: Phases
    robot: np.ndarray
    preparation: np.ndarray
    homing: np.ndarray

    @property
    def num_parts(self) -> int:
        """N + 3: how many draws make an episode."""
        return len(self.human) + 3

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draws episodes: (count, N + 3) indices of draws."""
        return rng.integers(self.human.shape[1], size=(count, self.num_parts))

    def episode(self, parts: np.ndarray) -> Episode:
        """The episode of one row of ``sample``, as the diagram takes it."""
        n = len(self.human)
        rows = np.arange(n)
        return Episode(
            human=self.human[rows, parts[:n]],
            demonstration=self.demonstration[rows, parts[:n]],
            robot=self.robot[parts[n]],
            preparation=self.preparation[parts[n + 1]],
            homing=self.homing[parts[n + 2]],
        )


def make_pool(scenario: Scenario, people: People, size: int, rng: np.random.Generator) -> Pool:
    """Draws a pool of ``size`` and computes the phases of its (demonstration, duration) pairs."""
    drawn = [people.sample(scenario, rng) for _ in range(size)]
    human = np.array([episode.human for episode in drawn]).T.copy()
    demonstration = np.array([episode.demonstration for episode in drawn]).T.copy()
    return Pool(
        human,
        demonstration,
        exact_phases(scenario, people, human, demonstration),
        np.array([episode.robot for episode in drawn]),
        np.array([episode.preparation for episode in drawn]),
        np.array([episode.homing for episode in drawn]),
    )


def exact_phases(scenario: Scenario, people: People, duration: np.ndarray, demonstration: np.ndarray) -> Phases:
    """Phases of the hand's samples for (demonstration, duration) pairs, by the scenario's own estimators.

    Args:
        scenario: gives the tracker's period and the estimators.
        people: whose hands.
        duration: (N, K) [s].
        demonstration: (N, K).
    """
    period = scenario.human.sample_period
    found: list[np.ndarray] = []
    for j, estimator in enumerate(people.estimators(scenario)):
        if estimator is None:
            found += [np.ones(1)] * duration.shape[1]  # joint actions: done (systems.PhaseEstimator)
            continue
        hands = []
        for seconds, index in zip(duration[j], demonstration[j], strict=True):
            # One sample more than ticks can fall into the action, whatever its start.
            times = np.arange(int(seconds / period) + 2) * period
            hand = people.demonstrations[j][int(index)]
            hands.append(np.array([hand.position(time, float(seconds)) for time in times]))
        found += estimator.phases(hands, num_threads=2)
    length = np.array([len(phases) for phases in found])
    shape = duration.shape
    start = np.concatenate([[0], np.cumsum(length)[:-1]])
    return Phases(np.concatenate(found), start.reshape(shape), length.reshape(shape))


class AssemblyTwin:
    """``num_envs`` assemblies, each at a decision, finished, or not started.

    Args:
        scenario: a validated scenario, whose person is observed as told.
        pool: of the same scenario.
        num_envs: how many.

    Attributes:
        observation: (num_envs, 4) the paper's O(s), in double precision; valid where ``status`` is DECISION.
        robot_idle, human_idle: (num_envs, L) [s] up to now.
        time: (num_envs,) [s].
        status: (num_envs,) DECISION or FINISHED; 0 before the first start.

    Raises:
        InputError: the scenario's chart is no task chart, or its person is not observed as told.
    """

    def __init__(self, scenario: Scenario, pool: Pool, num_envs: int = 1) -> None:
        if scenario.human.monitor != "told":
            raise InputError(
                f"human.monitor: the twin knows the person as told, not by {scenario.human.monitor!r}: use the diagram"
            )
        self.scenario, self.pool, self.num_envs = scenario, pool, num_envs
        task = scenario.task
        compiled = compile_chart(load_chart(scenario.chart_path()))
        chart = compiled.chart
        for group, names in _NEEDED.items():
            for name in names:
                if name not in getattr(chart, group):
                    raise InputError(f"{chart.path}: the twin needs {name!r} among the chart's {group}")
        parameters = {
            "M": float(task.num_robot_tasks),
            "L": float(task.num_joint_actions),
            "D0": float(scenario.decide_at_start),
            "Tdec": scenario.decision_timeout,
            "Twait": scenario.wait_timeout,
        }
        p = compiled.parameters(**{name: value for name, value in parameters.items() if name in chart.parameters})
        # A first decision at t = 0 sees the last robot task as done (docs/departures.md).
        x0 = compiled.initial_state(i=float(task.num_robot_tasks if scenario.decide_at_start else 1))
        joints = task.num_joint_actions
        self._weight = task.human_idle_weight
        self._state = np.zeros((num_envs, len(x0) + 2 + 7 + 3 + 2 * joints))
        self._parts = np.zeros((num_envs, pool.num_parts), dtype=np.int64)
        self._all = np.arange(num_envs)
        self.time = np.zeros(num_envs)
        self.observation = np.zeros((num_envs, 4))
        self.robot_idle = np.zeros((num_envs, joints))
        self.human_idle = np.zeros((num_envs, joints))
        self.status = np.zeros(num_envs, dtype=np.int64)
        joint = pool.human[np.array(task.human_index_of_joint) - 1].T
        self._kernel = _kernel_of(compiled, num_envs >= _PARALLEL)
        self._draws = (
            np.ascontiguousarray(pool.human),
            pool.robot.reshape(len(pool.robot), -1),
            pool.preparation,
            np.ascontiguousarray(joint),
            pool.homing,
            pool.phases.start,
            pool.phases.length,
            pool.phases.values,
            x0,
            p,
            np.array(task.human_index_of_joint),
            scenario.human.sample_period,
        )

    @property
    def cost(self) -> np.ndarray:
        """(num_envs,) [s] up to now."""
        return self.robot_idle.sum(axis=1) + self._weight * self.human_idle.sum(axis=1)

    def start(self, envs: np.ndarray, parts: np.ndarray) -> None:
        """Starts episodes and advances them to their first decision.

        Args:
            envs: (n,) which environments.
            parts: (n, N + 3) rows of ``Pool.sample``.
        """
        envs = np.asarray(envs, dtype=np.int64)
        self._parts[envs] = parts
        self._advance(envs, np.full(len(envs), np.nan))

    def step(self, actions: np.ndarray, envs: np.ndarray | None = None) -> None:
        """Carries out one decision in every environment and advances to the next.

        Args:
            actions: 0 go on, 1 assist; one for each of ``envs``.
            envs: which environments; None: all.

        Raises:
            ValueError: an action that is neither, or not one for each.
            RuntimeError: an environment is finished or not started, or its chart does not come to rest.
        """
        answers = np.asarray(actions, dtype=float)
        if not ((answers == 0) | (answers == 1)).all():
            raise ValueError(f"actions must be 0 or 1, not {actions}")
        envs = self._all if envs is None else np.asarray(envs, dtype=np.int64)
        if len(answers) != len(envs):
            raise ValueError(f"{len(envs)} environments need as many actions, not {len(answers)}")
        if (self.status[envs] != DECISION).any():
            env = int(envs[np.argmax(self.status[envs] != DECISION)])
            raise RuntimeError(f"environment {env} is not at a decision; start it")
        self._advance(envs, answers)

    def _advance(self, envs: np.ndarray, answers: np.ndarray) -> None:
        worst = self._kernel(
            envs, answers, self._state, self._parts, self._draws, self.time, self.observation, self.robot_idle,
            self.human_idle, self.status,
        )  # fmt: skip
        if worst > FINISHED:
            env = int(np.argmax(self.status > FINISHED))
            what = "nothing will happen any more" if self.status[env] == NO_EVENT else "the chart does not come to rest"
            raise RuntimeError(f"environment {env} at t = {self.time[env]} s: {what}")


#: Places in the robot's and the idle meter's state.
_NUMBER, _KIND, _INDEX, _DURATION, _SINCE, _ACTIVE, _DONE = range(7)
_KIND_TASK, _KIND_PREPARE, _KIND_JOINT = (
    float(kind) for kind in (ActionKind.ROBOT_TASK, ActionKind.PREPARE, ActionKind.JOINT)
)
_KIND_NONE, _KIND_HOLD = float(ActionKind.NONE), float(ActionKind.HOLD)


@njit
def _person_now(
    human: np.ndarray, person: np.ndarray, alpha: np.ndarray, time: float
) -> tuple[int, float, bool, int, int, float]:
    """(action, its start, waiting, joint, joints done, next event), as ``systems.Human._now``."""
    begun, start = int(person[0]), person[1]
    first = alpha[begun - 1] if begun > 0 else 1
    waits = begun < len(alpha)
    end = alpha[begun] if waits else len(human) + 1
    done = max(begun - 1, 0)
    for action in range(first, end):
        until = start + human[action - 1]
        if time < until:
            return action, start, False, begun if begun > 0 and action == first else 0, done, until
        done, start = begun, until
    if waits:
        return end, start, True, begun + 1, begun, np.inf
    return len(human), start, False, 0, done, np.inf


@njit
def _ticks_before(time: float, period: float) -> int:
    """How many ticks of the tracker (at 0, period, ...) are before ``time``."""
    k = max(int(time / period) - 1, 0)
    while k * period < time:
        k += 1
    return k


#: Compiled once for each chart: it takes seconds.
_KERNELS: dict[tuple, Any] = {}


def _kernel_of(compiled: CompiledChart, parallel: bool) -> Any:
    chart = compiled.chart
    decides = tuple(chart.states[leaf].decision is not None for leaf in chart.leaves)
    final = tuple(any(chart.states[s].final for s in chart.ancestors(leaf)) for leaf in chart.leaves)
    names = tuple(chart.inputs.items()), tuple(chart.outputs), tuple(chart.variables), tuple(chart.histories)
    key = (compiled.source, names, decides, final, parallel)
    if key not in _KERNELS:
        _KERNELS[key] = _kernel(compiled, np.array(decides), np.array(final), parallel)
    return _KERNELS[key]


def _kernel(compiled: CompiledChart, decides: np.ndarray, final: np.ndarray, parallel: bool) -> Any:
    """The compiled advance of a chart, from decision to decision."""
    chart = compiled.chart
    react: Any = njit(compiled.react_in_place)
    outputs: Any = njit(compiled.outputs)
    deadline: Any = njit(compiled.next_deadline)
    u0 = compiled.inputs()
    in_a, in_done, in_rb, in_hj, in_nj = (compiled.input_index[name] for name in _NEEDED["inputs"])
    out_kind, out_index, out_number, out_ready, out_waiting = (
        compiled.output_index[name] for name in _NEEDED["outputs"]
    )
    place_i = compiled.variable_index["i"]
    absent = chart.inputs["a"]
    # Where each part of a row of the state begins: chart, person (2), robot (7), idle meter (3 + 2 L).
    of_person = 1 + len(chart.histories) + len(chart.variables)
    of_robot, of_idle = of_person + 2, of_person + 9

    @njit
    def to_rest(x, u, p, time):
        reactions = 0
        while react(x, u, p, time) >= 0:
            reactions += 1
            if reactions > MAX_CHAIN:
                return False
        return True

    @njit
    def observe(now, x, idle, parts, time, draws, observation, robot_idle, human_idle):
        action, start, waiting, joint, _, _ = now
        phase_start, phase_length, phases, period = draws[5], draws[6], draws[7], draws[11]
        observation[0], observation[1], observation[2] = x[place_i], action, time - start
        if waiting or joint > 0:
            observation[3] = 1.0
        else:
            # The estimator has seen one sample at each tick since the action began; after its end the last one counts.
            pair = parts[action - 1]
            ticks = _ticks_before(time, period) - _ticks_before(start, period)
            last = min(ticks, phase_length[action - 1, pair]) - 1
            observation[3] = phases[phase_start[action - 1, pair] + last] if ticks > 0 else 0.0
        joints = len(robot_idle)
        for k in range(joints):
            robot_idle[k], human_idle[k] = idle[3 + k], idle[3 + joints + k]
        if idle[1] > 0:
            robot_idle[int(idle[1]) - 1] += time - idle[0]
        if idle[2] > 0:
            human_idle[int(idle[2]) - 1] += time - idle[0]

    @njit
    def begin(robot, values, parts, time, draws):
        human, robot_draws, preparation, joint_draws, homing, alpha = (
            draws[0], draws[1], draws[2], draws[3], draws[4], draws[10],
        )  # fmt: skip
        n, kind, number = len(human), values[out_kind], values[out_number]
        index = int(values[out_index]) - 1
        if kind == _KIND_TASK:
            num_tasks = robot_draws.shape[1] // NUM_ROBOT_DRAWS
            robot[_DURATION] = robot_draws[parts[n], (int(number) - 1) % NUM_ROBOT_DRAWS * num_tasks + index]
        elif kind == _KIND_PREPARE:
            robot[_DURATION] = preparation[parts[n + 1], index]
        elif kind == _KIND_JOINT:
            robot[_DURATION] = joint_draws[parts[alpha[index] - 1], index]
        else:
            robot[_DURATION] = homing[parts[n + 2], index]
        robot[_KIND], robot[_INDEX], robot[_NUMBER] = kind, index + 1, number
        robot[_SINCE], robot[_ACTIVE] = time, 1.0

    @njit
    def advance_one(answer, state, parts, draws, time, observation, robot_idle, human_idle):
        human, x0, p, alpha = draws[0], draws[8], draws[9], draws[10]
        x, person = state[:of_person], state[of_person:of_robot]
        robot, idle = state[of_robot:of_idle], state[of_idle:]
        joints = len(robot_idle)
        u, seconds = u0.copy(), np.empty(len(human))
        for k in range(len(human)):
            seconds[k] = human[k, parts[k]]
        if np.isnan(answer):  # a fresh start
            state[:] = 0.0
            x[:] = x0
            time = 0.0
        while True:
            done = robot[_ACTIVE] > 0 and time >= robot[_SINCE] + robot[_DURATION]
            now = _person_now(seconds, person, alpha, time)
            u[in_a] = absent
            u[in_done] = robot[_NUMBER] if done else robot[_DONE]
            u[in_rb] = 1.0 if robot[_ACTIVE] > 0 and not done else 0.0
            u[in_hj], u[in_nj] = now[3], now[4]
            # The chart reads the same in one instant, so that it may wait in DECIDE for the answer.
            if not to_rest(x, u, p, time):
                return NO_REST, time
            if decides[int(x[0])]:
                if np.isnan(answer):
                    observe(now, x, idle, parts, time, draws, observation, robot_idle, human_idle)
                    return DECISION, time
                u[in_a] = answer
                react(x, u, p, time)
                u[in_a] = absent
                answer = np.nan
                if not to_rest(x, u, p, time):
                    return NO_REST, time
            # Then the robot, the person and the idle meter: each sees what those before it have done.
            values = outputs(x, p)
            if done:
                robot[_DONE], robot[_ACTIVE] = robot[_NUMBER], 0.0
            kind = values[out_kind]
            if kind != _KIND_HOLD and kind != _KIND_NONE and values[out_number] != robot[_NUMBER]:
                begin(robot, values, parts, time, draws)
            if now[2] and values[out_ready] == now[3]:
                person[0], person[1] = now[3], time
                now = _person_now(seconds, person, alpha, time)
            if idle[1] > 0:
                idle[2 + int(idle[1])] += time - idle[0]
            if idle[2] > 0:
                idle[2 + joints + int(idle[2])] += time - idle[0]
            idle[0], idle[1], idle[2] = time, values[out_waiting], now[3] if now[2] else 0.0
            if final[int(x[0])]:
                observe(now, x, idle, parts, time, draws, observation, robot_idle, human_idle)
                return FINISHED, time
            following = min(now[5], deadline(x, u, p, time))
            if robot[_ACTIVE] > 0:
                following = min(following, robot[_SINCE] + robot[_DURATION])
            if following == np.inf:
                return NO_EVENT, time
            time = following

    @njit(parallel=parallel)
    def advance(envs, answers, state, parts, draws, time, observation, robot_idle, human_idle, status):
        worst = 0
        for k in prange(len(envs)):
            e = envs[k]
            status[e], time[e] = advance_one(
                answers[k], state[e], parts[e], draws, time[e], observation[e], robot_idle[e], human_idle[e]
            )
            worst = max(worst, status[e])
        return worst

    return advance
