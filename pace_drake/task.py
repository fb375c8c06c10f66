"""The collaborative task of PACE (paper, Sec. III): actions, indices, durations, cost weight.

Glossary of the paper's symbols, used as names everywhere (all indices are 1-based, as printed):

====== =========================== ==========================================================
symbol name                        meaning
====== =========================== ==========================================================
i      robot_task_index            robot-task action a_i^R, i in 1..M
j      human_action_index          human action a_j^H, j in 1..N
l      joint_action_index          joint action a_l^J, l in 1..L
alpha  human_index_of_joint        human action index of a joint action: a_alpha(l)^H = a_l^J
lambda human_idle_weight           weight of human idle time in the cost (Eq. 1)
====== =========================== ==========================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from math import isfinite, log
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, ndtri

from pace_drake.errors import require

if TYPE_CHECKING:
    import networkx as nx


class ActionKind(IntEnum):
    """What the robot is told to do; the first element of the ``robot_action`` port."""

    NONE = 0
    ROBOT_TASK = 1
    PREPARE = 2
    JOINT = 3
    HOME = 4
    #: Homing from the prepared pose: the joint action did not take place.
    HOME_ABORTED = 5
    #: Stay where you are (stopped, or in fault).
    HOLD = 6


DISTRIBUTIONS = ("truncated_gaussian", "log_normal")


@dataclass(kw_only=True)
class Duration:
    """A random duration (paper, Sec. IV-C; truncated because a Gaussian duration may be negative)."""

    mean: float = 1.0
    """[s] mean of the distribution before truncation."""
    cv: float = 0.0
    """[-] coefficient of variation (standard deviation / mean); 0 makes it deterministic."""
    minimum: float = 0.0
    """[s] no draw is shorter."""
    distribution: str = "truncated_gaussian"
    """``truncated_gaussian`` (the paper's Gaussian, cut) or ``log_normal`` (fits human timing)."""

    def validate(self, name: str) -> None:
        """Raises InputError that names the field if a value cannot be used."""
        require(isfinite(self.mean) and self.mean > 0, f"{name}.mean", f"must be > 0 [s], is {self.mean}")
        require(isfinite(self.cv) and self.cv >= 0, f"{name}.cv", f"must be >= 0, is {self.cv}")
        require(
            0 <= self.minimum <= self.mean,
            f"{name}.minimum",
            f"must lie in [0, mean = {self.mean}] [s], is {self.minimum}",
        )
        require(
            self.distribution in DISTRIBUTIONS,
            f"{name}.distribution",
            f"must be one of {', '.join(DISTRIBUTIONS)}, is {self.distribution!r}",
        )

    def quantile(self, probability: np.ndarray | float) -> np.ndarray:
        """Inverse cumulative distribution: uniform draws in, durations [s] of the same shape out."""
        u = np.asarray(probability, dtype=float)
        if self.cv == 0:
            return np.full(u.shape, self.mean)
        lower = ndtr(self._score(self.minimum))
        score = ndtri(lower + u * (1 - lower))
        if self.distribution == "log_normal":
            mu, sigma = self._log_moments()
            value = np.exp(mu + sigma * score)
        else:
            value = self.mean + self.cv * self.mean * score
        return np.maximum(value, self.minimum)

    def cdf(self, seconds: np.ndarray | float) -> np.ndarray:
        """Cumulative distribution: the inverse of ``quantile``."""
        x = np.asarray(seconds, dtype=float)
        if self.cv == 0:
            return (x >= self.mean).astype(float)
        lower = ndtr(self._score(self.minimum))
        return np.where(x < self.minimum, 0.0, (ndtr(self._score(x)) - lower) / (1 - lower))

    def _score(self, seconds: np.ndarray | float) -> np.ndarray:
        """Standard normal score of a duration, before truncation."""
        x = np.asarray(seconds, dtype=float)
        if self.distribution == "log_normal":
            mu, sigma = self._log_moments()
            with np.errstate(divide="ignore"):
                return (np.log(np.maximum(x, 0.0)) - mu) / sigma
        return (x - self.mean) / (self.cv * self.mean)

    def _log_moments(self) -> tuple[float, float]:
        sigma = float(np.sqrt(np.log1p(self.cv**2)))
        return log(self.mean) - 0.5 * sigma**2, sigma


@dataclass(kw_only=True)
class Assistance:
    """What the robot does around one joint action: preparing before it and homing after it."""

    preparation: Duration = field(default_factory=Duration)
    homing: Duration = field(default_factory=Duration)


@dataclass(kw_only=True)
class HumanAction:
    """One action of the person; a joint action if the robot assists in it."""

    name: str = ""
    duration: Duration = field(default_factory=Duration)
    assistance: Assistance | None = None

    @property
    def joint(self) -> bool:
        """Whether the robot takes part."""
        return self.assistance is not None


@dataclass(kw_only=True)
class RobotTask:
    """One of the robot's own actions, repeated for ever in order."""

    name: str = ""
    duration: Duration = field(default_factory=Duration)


@dataclass(kw_only=True)
class Task:
    """The whole collaborative task: what the person does, what the robot does meanwhile, and what idling costs."""

    human_actions: list[HumanAction] = field(default_factory=list)
    robot_tasks: list[RobotTask] = field(default_factory=list)
    human_idle_weight: float = 3.0
    """[-] lambda of Eq. 1."""

    def validate(self, name: str = "task") -> None:
        """Checks what the paper assumes of a task (Sec. III).

        Raises:
            InputError: names the field: no action, duplicate or empty name, last human action not joint, two
                consecutive joint actions, a duration that cannot be used, lambda <= 0.
        """
        weight = self.human_idle_weight
        require(isfinite(weight) and weight > 0, f"{name}.human_idle_weight", f"lambda must be > 0, is {weight}")
        require(bool(self.human_actions), f"{name}.human_actions", "at least one action is needed")
        require(bool(self.robot_tasks), f"{name}.robot_tasks", "at least one task is needed")
        groups: dict[str, Sequence[HumanAction | RobotTask]]
        groups = {"human_actions": self.human_actions, "robot_tasks": self.robot_tasks}
        for group, actions in groups.items():
            seen: set[str] = set()
            for k, action in enumerate(actions):
                at = f"{name}.{group}[{k}]"
                require(bool(action.name), f"{at}.name", "must not be empty")
                require(action.name not in seen, f"{at}.name", f"{action.name!r} is used twice")
                seen.add(action.name)
                action.duration.validate(f"{at}.duration")
        for k, action in enumerate(self.human_actions):
            at = f"{name}.human_actions[{k}]"
            if action.assistance is not None:
                action.assistance.preparation.validate(f"{at}.assistance.preparation")
                action.assistance.homing.validate(f"{at}.assistance.homing")
                require(
                    k == 0 or not self.human_actions[k - 1].joint,
                    f"{at}.assistance",
                    f"{action.name!r} follows another joint action; two in a row are not allowed",
                )
        last = self.human_actions[-1]
        require(
            last.joint,
            f"{name}.human_actions[{len(self.human_actions) - 1}].assistance",
            f"the last human action must be a joint action, {last.name!r} is not",
        )

    @property
    def num_human_actions(self) -> int:
        """N."""
        return len(self.human_actions)

    @property
    def num_robot_tasks(self) -> int:
        """M."""
        return len(self.robot_tasks)

    @cached_property
    def human_index_of_joint(self) -> tuple[int, ...]:
        """alpha: element l - 1 is the 1-based human action index of joint action l."""
        return tuple(k + 1 for k, action in enumerate(self.human_actions) if action.joint)

    @property
    def num_joint_actions(self) -> int:
        """L."""
        return len(self.human_index_of_joint)

    @cached_property
    def assistances(self) -> tuple[Assistance, ...]:
        """Preparation and homing of each joint action, in order."""
        return tuple(a.assistance for a in self.human_actions if a.assistance is not None)

    def precedence(self) -> "nx.DiGraph":
        """What must come before what: human actions in order, and preparation -> joint action -> homing.

        Returns:
            A directed acyclic graph; nodes are action names, with attribute ``agent`` in {human, robot, joint}.
        """
        import networkx as nx  # 0.2 s, which most commands do not need

        graph = nx.DiGraph()
        for action in self.human_actions:
            graph.add_node(action.name, agent="joint" if action.joint else "human")
        nx.add_path(graph, [action.name for action in self.human_actions])
        homed: str | None = None
        for action in self.human_actions:
            if action.joint:
                prepare, home = f"prepare {action.name}", f"home {action.name}"
                graph.add_node(prepare, agent="robot")
                graph.add_node(home, agent="robot")
                nx.add_path(graph, [prepare, action.name, home])
                if homed is not None:
                    graph.add_edge(homed, prepare)
                homed = home
        return graph


#: Robot-task durations are drawn per transition (notes: resolutions); this many are drawn ahead per episode.
NUM_ROBOT_DRAWS = 256


@dataclass(frozen=True)
class Episode:
    """Everything random in one episode, drawn at its start (paper, Sec. IV-C).

    Attributes:
        human: (N,) [s] durations of the human actions, joint ones included.
        demonstration: (N,) index of the demonstration played in each non-joint action; -1 for joint actions.
        robot: (NUM_ROBOT_DRAWS, M) [s] durations of robot tasks; the command with sequence number s that starts
            task i takes ``robot[(s - 1) % NUM_ROBOT_DRAWS, i - 1]``.
        preparation: (L,) [s].
        homing: (L,) [s].
    """

    human: np.ndarray
    demonstration: np.ndarray
    robot: np.ndarray
    preparation: np.ndarray
    homing: np.ndarray


def sample_episode(
    task: Task, rng: np.random.Generator, num_demonstrations: list[int], pace: float = 0.0, correlation: float = 0.0
) -> Episode:
    """Draws one episode.

    Args:
        task: a validated task.
        rng: the only source of randomness; the order of draws is fixed, so the same state gives the same episode.
        num_demonstrations: (N,) how many demonstrations each human action has; 0 for joint actions.
        pace: the person's, as a standard normal score; above 0 is slower.
        correlation: in [0, 1), of the scores of one person's non-joint actions. Over people whose pace is standard
            normal each duration keeps its own distribution (a Gaussian copula); 0 draws them independently.
    """
    n, m, joints = task.num_human_actions, task.num_robot_tasks, task.num_joint_actions
    u_human, u_prepare, u_home = rng.random(n), rng.random(joints), rng.random(joints)
    if correlation > 0:
        alone = [k for k, action in enumerate(task.human_actions) if not action.joint]
        scores = np.sqrt(correlation) * pace + np.sqrt(1 - correlation) * ndtri(u_human[alone])
        u_human[alone] = ndtr(scores)
    u_robot = rng.random((NUM_ROBOT_DRAWS, m))
    u_demonstration = rng.random(n)
    return Episode(
        human=np.array([float(a.duration.quantile(u)) for a, u in zip(task.human_actions, u_human, strict=True)]),
        demonstration=np.array(
            [int(u * count) if count else -1 for u, count in zip(u_demonstration, num_demonstrations, strict=True)]
        ),
        robot=np.column_stack([r.duration.quantile(u_robot[:, k]) for k, r in enumerate(task.robot_tasks)]),
        preparation=np.array(
            [float(a.preparation.quantile(u)) for a, u in zip(task.assistances, u_prepare, strict=True)]
        ),
        homing=np.array([float(a.homing.quantile(u)) for a, u in zip(task.assistances, u_home, strict=True)]),
    )
