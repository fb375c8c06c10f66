"""Human: a simulated person who works through the task and waits where a joint action needs the robot."""

from collections.abc import Sequence
from functools import partial
from math import floor, inf
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.demos import Demonstration
from pace_drake.ports import declare_input, declare_output, declare_update
from pace_drake.task import Episode, Task


class _Now(NamedTuple):
    """Where the person is at one instant."""

    action: int  # j [1-based]
    start: float  # [s]
    waiting: bool
    joint: int  # l at which the person waits or which is being done; 0 none
    joints_done: int
    next_event: float  # [s]


class Human(LeafSystem):
    """A person whose action durations and demonstrations were drawn at the start of the episode (paper, Sec. IV-C).

    Non-joint actions follow each other; at a joint action the person waits until the robot is ready. The hand follows
    a demonstration whose time axis is rescaled to the drawn duration (the paper's augmentation). Between joint
    actions everything is a function of time, so events happen at exact times, not at ticks.

    Inputs:
        joint_ready (1): l when the robot is ready to perform joint action l, else 0.

    Outputs:
        p_WH (3) [m]: position of the right hand in world, continuous in time (pictures, distances).
        p_WH_sampled (3) [m]: what a tracker at ``sample_period`` delivers; its clock restarts with each action.
        human_action (1): j [1-based]; N after the end.
        human_elapsed (1) [s]: time since action j began; while waiting, time since the waiting began.
        human_waiting (1): 1 while waiting for the robot at joint action j.
        human_joint (1): l while waiting at or performing joint action l, else 0.
        joints_done (1): number of joint actions finished.
        next_event_time (1) [s]: when human_action, human_waiting, human_joint or joints_done change next by
            themselves; inf if they will not.

    State:
        [joint actions begun, time at which the last of them began [s], N durations [s], N demonstration indices].

    Events:
        update: begins the joint action when the robot is ready (forced or periodic).

    Args:
        task: a validated task.
        demonstrations: for each human action its demonstrations; empty for joint actions.
        joint_paths: for each joint action the places of the hand in it: (share of its time, (3) p_WH [m]); empty: from
            where the last action left it straight to where the next begins.
        sample_period: [s] of the hand tracker.
        reaction_period: see ``declare_update``.
    """

    def __init__(
        self,
        task: Task,
        demonstrations: list[list[Demonstration]],
        joint_paths: Sequence[Sequence[tuple[float, np.ndarray]]] = (),
        sample_period: float = 0.1,
        reaction_period: float | None = None,
    ) -> None:
        super().__init__()
        self.set_name("human")
        self._n = task.num_human_actions
        self._alpha = task.human_index_of_joint
        self._demonstrations = demonstrations
        self._joint_paths = [list(path) for path in joint_paths] or [[] for _ in self._alpha]
        self._sample_period = sample_period
        # A tenth of a nanosecond: the clock of the tracker must not lose a sample to rounding.
        self._slack = 1e-10 / sample_period

        self.DeclareDiscreteState(2 + 2 * self._n)
        self._joint_ready = declare_input(self, "joint_ready")
        now = {self.xd_ticket(), self.time_ticket()}
        declare_output(self, "p_WH", partial(self._position, sampled=False), now, size=3)
        declare_output(self, "p_WH_sampled", partial(self._position, sampled=True), now, size=3)
        declare_output(self, "human_action", lambda context: self._now(context).action, now)
        declare_output(self, "human_elapsed", self._elapsed, now)
        declare_output(self, "human_waiting", lambda context: self._now(context).waiting, now)
        declare_output(self, "human_joint", lambda context: self._now(context).joint, now)
        declare_output(self, "joints_done", lambda context: self._now(context).joints_done, now)
        declare_output(self, "next_event_time", lambda context: self._now(context).next_event, now)
        declare_update(self, self._update, reaction_period)

    def set_episode(self, context: Context, episode: Episode) -> None:
        """Puts the drawn durations and demonstrations into the context; the person starts at its time."""
        context.SetDiscreteState(np.concatenate([[0.0, context.get_time()], episode.human, episode.demonstration]))

    def progress(self, context: Context) -> float:
        """True share in [0, 1] of the current action's time that has passed; 1 while waiting. For evaluation only."""
        now = self._now(context)
        duration = self._state(context)[1 + now.action]
        return 1.0 if now.waiting else min((context.get_time() - now.start) / duration, 1.0)

    @staticmethod
    def _state(context: Context) -> list[float]:
        # A list: at every tick of the tracker some are read, and an element of an array costs as much as all of them.
        return context.get_discrete_state_vector().value().tolist()

    def _now(self, context: Context) -> _Now:
        return self._at(self._state(context), context.get_time())

    def _at(self, state: list[float], time: float) -> _Now:
        begun, start = int(state[0]), state[1]
        # Actions of this segment: the joint action that was begun (none before the first), then up to the next one.
        first = self._alpha[begun - 1] if begun else 1
        waits = begun < len(self._alpha)
        end = self._alpha[begun] if waits else self._n + 1
        done = max(begun - 1, 0)
        for action in range(first, end):
            until = start + state[1 + action]
            if time < until:
                return _Now(action, start, False, begun if begun and action == first else 0, done, until)
            done, start = begun, until
        if waits:
            return _Now(end, start, True, begun + 1, begun, inf)
        return _Now(self._n, start, False, 0, done, inf)

    def _elapsed(self, context: Context) -> float:
        return context.get_time() - self._now(context).start

    def _update(self, context: Context, values: DiscreteValues) -> None:
        now = self._now(context)
        if now.waiting and self._joint_ready.Eval(context)[0] == now.joint:
            x = values.get_mutable_value(0)
            x[0] = now.joint
            x[1] = context.get_time()

    def _position(self, context: Context, sampled: bool) -> np.ndarray:
        state, time = self._state(context), context.get_time()
        now = self._at(state, time)
        elapsed = time - now.start
        if sampled:
            elapsed = floor(elapsed / self._sample_period + self._slack) * self._sample_period
        if now.joint == 0 and not now.waiting and self._demonstrations[now.action - 1]:
            return self._demonstration(state, now.action).position(elapsed, state[1 + now.action])
        # Waiting, the hand rests where the last action left it; in a joint action it goes where that takes it, and then
        # to where the next action begins.
        before = self._rest(state, now.action - 1, end=True)
        after = self._rest(state, now.action + 1, end=False)
        if now.waiting or now.joint == 0:
            return np.zeros(3) if before is None else before
        path = self._joint_paths[now.joint - 1]
        places = [place for place in (before, *(p for _, p in path), after) if place is not None]
        if not places:
            return np.zeros(3)
        start, end = places[0] if before is None else before, places[-1] if after is None else after
        shares = [0.0, *(share for share, _ in path), 1.0]
        places = [start, *(p for _, p in path), end]
        share = min(elapsed / state[1 + now.action], 1.0)
        k = min(int(np.searchsorted(shares, share, side="right")), len(shares) - 1)
        s = (share - shares[k - 1]) / (shares[k] - shares[k - 1])
        return places[k - 1] + (places[k] - places[k - 1]) * s**3 * (10 - 15 * s + 6 * s**2)  # minimum jerk

    def _demonstration(self, state: list[float], action: int) -> Demonstration:
        return self._demonstrations[action - 1][int(state[1 + self._n + action])]

    def _rest(self, state: list[float], action: int, end: bool) -> np.ndarray | None:
        if not 1 <= action <= self._n or not self._demonstrations[action - 1]:
            return None
        return self._demonstration(state, action).p_WH[-1 if end else 0]
