"""AssemblyTwin: many episodes of the task level at once, compiled, without Drake.

It runs the same compiled chart as the diagram (``CompiledChart.react_in_place``), and the event order of
``pace_drake.simulation.Simulation``: at an event the chart reacts to rest, then the robot, the person and the idle
meter update, then time goes on to the next event. A test holds both equal, decision by decision.

Phases are exact. The estimator takes one sample of the hand per tick of the tracker, and the samples depend on the
demonstration and on the drawn duration of the action alone; so the phases of a (demonstration, duration) pair are
computed once, by the estimator of the scenario itself, and looked up by the number of ticks since the action began. A
``Pool`` holds such pairs; episodes are put together from them. The phase of another duration is never taken instead.
"""

from collections.abc import Mapping

import numpy as np
from numba import set_num_threads

from pace_drake.envs.kernel import DECISION, FINISHED, NO_EVENT, make_kernel
from pace_drake.envs.pool import Pool
from pace_drake.errors import InputError
from pace_drake.observation import FUSED_SETS, OBSERVATION_SETS
from pace_drake.scenario import Scenario
from pace_drake.task_chart import make_task_chart

#: Columns of ``AssemblyTwin.seen`` that each observation set sees.
_COLUMNS = {
    name: [0, 1, 2, *((4, 5, 6, 7) if name in FUSED_SETS else (3,))][:size] for name, size in OBSERVATION_SETS.items()
}

#: The arrays of ``AssemblyTwin.snapshot``.
_STATE = ("_state", "_parts", "time", "seen", "robot_idle", "human_idle", "status")


class AssemblyTwin:
    """``num_envs`` assemblies, each at a decision, finished, or not started.

    Args:
        scenario: a validated scenario, whose person is observed as told.
        pool: of the same scenario.
        num_envs: how many.
        num_threads: that share them. With more than 1 the machine must be free: threads wait for each other at every
            step, and a busy core makes that far slower than one thread.

    Attributes:
        seen: (num_envs, 8) robot_task, human_action, human_elapsed [s], phase; the phase filter's phase, phase_std,
            remaining_time [s]; pace; valid where ``status`` is DECISION. See ``observe``.
        robot_idle, human_idle: (num_envs, L) [s] up to now.
        time: (num_envs,) [s].
        status: (num_envs,) DECISION or FINISHED; 0 before the first start.

    Raises:
        InputError: the scenario's chart is no task chart, or its person is not observed as told.
    """

    def __init__(self, scenario: Scenario, pool: Pool, num_envs: int = 1, num_threads: int = 1) -> None:
        if scenario.human.monitor != "told":
            raise InputError(
                f"human.monitor: the twin knows the person as told, not by {scenario.human.monitor!r}: use the diagram"
            )
        self.scenario, self.pool, self.num_envs, self.num_threads = scenario, pool, num_envs, num_threads
        task = scenario.task
        compiled, p, x0 = make_task_chart(scenario)
        chart = compiled.chart
        joints = task.num_joint_actions
        self._weight, self._alpha = task.human_idle_weight, np.array(task.human_index_of_joint)
        self._state = np.zeros(
            (num_envs, len(x0) + 2 + 7 + 3 + 2 * joints + task.num_human_actions + len(chart.inputs))
        )
        self._parts = np.zeros((num_envs, pool.num_parts), dtype=np.int64)
        self._all = np.arange(num_envs)
        self.time = np.zeros(num_envs)
        self.seen = np.zeros((num_envs, 8))
        self.robot_idle = np.zeros((num_envs, joints))
        self.human_idle = np.zeros((num_envs, joints))
        self.status = np.zeros(num_envs, dtype=np.int64)
        joint = pool.human[np.array(task.human_index_of_joint) - 1].T
        self._kernel = make_kernel(compiled, num_threads > 1)
        draws = (
            pool.human,
            pool.robot.reshape(len(pool.robot), -1),
            pool.preparation,
            joint,
            pool.homing,
            pool.phases.start,
            pool.phases.length,
            pool.phases.values,
            x0,
            p,
            self._alpha,
            pool.phases.before,
            np.array([0.0 if action.joint else 1 / action.duration.mean for action in task.human_actions]),
        )
        self._draws = (*(np.ascontiguousarray(one) for one in draws), scenario.human.sample_period)

    def observe(self, observation_set: str | None = None, envs: np.ndarray | None = None) -> np.ndarray:
        """(num_envs, D) what a policy sees, in single precision, as in the diagram; a copy.

        Args:
            observation_set: None: the scenario's.
            envs: which environments; None: all.
        """
        name = self.scenario.observation if observation_set is None else observation_set
        columns = _COLUMNS[name]
        return (self.seen if envs is None else self.seen[envs])[:, columns].astype(np.float32)

    def segment(self, envs: np.ndarray) -> np.ndarray:
        """(n,) the next joint action of environments at a decision, from 0."""
        return np.searchsorted(self._alpha, self.seen[envs, 1])

    def time_until_ready(self, envs: np.ndarray) -> np.ndarray:
        """(n,) [s] until the person is ready for the next joint action, 0 while they wait; an oracle alone knows it.

        Args:
            envs: (n,) environments at a decision.
        """
        n = len(self.pool.human)
        human = self.pool.human[np.arange(n), self._parts[envs, :n]]
        begun = np.cumsum(human, axis=1) - human  # time of work before each action
        rows, action = np.arange(len(envs)), self.seen[envs, 1].astype(int)
        joint = self._alpha[self.segment(envs)]
        left = begun[rows, joint - 1] - begun[rows, action - 1] - self.seen[envs, 2]
        return np.where(action == joint, 0.0, np.maximum(left, 0.0))

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

    def snapshot(self) -> dict[str, np.ndarray]:
        """Copies of all arrays in which this twin differs from a new one of the same scenario, pool and size."""
        return {name: getattr(self, name).copy() for name in _STATE}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Goes back to a ``snapshot``, of this twin or of one like it.

        Raises:
            ValueError: the arrays are of another twin.
        """
        for name in _STATE:
            own, given = getattr(self, name), arrays[name]
            if (own.shape, own.dtype) != (given.shape, given.dtype):
                raise ValueError(f"{name}: is {given.shape} of {given.dtype}, not {own.shape} of {own.dtype}")
        if not ((arrays["_parts"] >= 0) & (arrays["_parts"] < self.pool.human.shape[1])).all():
            raise ValueError("_parts: not of this pool")  # the compiled kernel looks up without asking
        for name in _STATE:
            getattr(self, name)[:] = arrays[name]

    def _advance(self, envs: np.ndarray, answers: np.ndarray) -> None:
        if self.num_threads > 1:
            set_num_threads(self.num_threads)
        worst = self._kernel(
            envs, answers, self._state, self._parts, self._draws, self.time, self.seen, self.robot_idle,
            self.human_idle, self.status,
        )  # fmt: skip
        if worst > FINISHED:
            env = int(np.argmax(self.status > FINISHED))
            what = "nothing will happen any more" if self.status[env] == NO_EVENT else "the chart does not come to rest"
            raise RuntimeError(f"environment {env} at t = {self.time[env]} s: {what}")
