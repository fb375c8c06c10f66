"""RobotAction: carries out what the statechart commands, one motion per command."""

from typing import Protocol

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.systems.ports import declare_input, declare_output, declare_update
from pace_drake.task import NUM_ROBOT_DRAWS, ActionKind, Episode, Task

#: [s] how soon an arm that has not arrived at the end of its motion is looked at again.
_ARRIVAL_POLL = 0.01


class Motions(Protocol):
    """Planned motions, as ``pace_drake.stations.motions.MotionLibrary`` offers them."""

    @property
    def home(self) -> np.ndarray:
        """(7,) [rad] where robot tasks begin and end."""

    def position(self, kind: ActionKind, index: int, fraction: float) -> np.ndarray:
        """(7,) [rad] joint positions after ``fraction`` of the motion."""

    def gripper_width(self, kind: ActionKind, index: int, fraction: float) -> float:
        """[m]."""

    def minimum_duration(self, kind: ActionKind, index: int) -> float:
        """[s] within the joint limits."""


class RobotAction(LeafSystem):
    """Turns commands into timed motions; holds on HOLD and goes on where it was when the command is issued again.

    A command is new when its sequence number is. ``motion_done`` is the sequence number of the last finished command,
    so that a late reader can neither miss nor repeat one (docs/statechart.md).

    Inputs:
        robot_action (3): kind, index, sequence number.
        position_measured (7) [rad]: only with motions; a motion is done when its time is over and the arm is there.

    Outputs:
        motion_done (1): sequence number of the last finished command; 0 before the first.
        robot_busy (1): 1 while a motion runs.
        motion_progress (3): kind, index, fraction in [0, 1] of the motion that runs or ran last.
        next_event_time (1) [s]: when motion_done changes next; inf if nothing runs.
        position (7) [rad], gripper_position (1) [m]: only with motions; the home position before the first command.

    State:
        [sequence, kind, index, start time [s], time done before start [s], duration [s], running, last done,
        robot-task durations (NUM_ROBOT_DRAWS * M) [s], preparation (L), joint (L), homing (L) [s]].

    Events:
        update: takes a new command, holds, or goes on (forced or periodic).

    Args:
        task: a validated task.
        motions: planned motions, or None at the task level, where actions only take time.
        arrival_tolerance: [rad] largest joint error at which a motion counts as done.
        reaction_period: see ``declare_update``.
    """

    def __init__(
        self,
        task: Task,
        motions: Motions | None = None,
        arrival_tolerance: float = 0.05,
        reaction_period: float | None = None,
    ) -> None:
        super().__init__()
        self.set_name("robot_action")
        self._m, self._joints = task.num_robot_tasks, task.num_joint_actions
        self._alpha = task.human_index_of_joint
        self._motions = motions
        self._tolerance = arrival_tolerance
        self._drawn = 8
        self.DeclareDiscreteState(self._drawn + NUM_ROBOT_DRAWS * self._m + 3 * self._joints)
        self._command = declare_input(self, "robot_action", 3)
        now = {self.xd_ticket(), self.time_ticket()}
        arrival = set(now)
        if motions is not None:
            self._measured = declare_input(self, "position_measured", 7)
            arrival.add(self.input_port_ticket(self._measured.get_index()))
            declare_output(self, "position", self._position, now, size=7)
            declare_output(self, "gripper_position", self._gripper, now)
        declare_output(self, "motion_done", self._motion_done, arrival)
        declare_output(self, "robot_busy", self._busy, arrival)
        declare_output(self, "motion_progress", self._progress, now, size=3)
        declare_output(self, "next_event_time", self._next_event_time, now)
        declare_update(self, self._update, reaction_period)

    def set_episode(self, context: Context, episode: Episode) -> None:
        """Puts the drawn durations into the context; no command has been taken yet."""
        joint = episode.human[[j - 1 for j in self._alpha]]
        context.SetDiscreteState(
            np.concatenate([np.zeros(self._drawn), episode.robot.ravel(), episode.preparation, joint, episode.homing])
        )

    def _duration(self, state: np.ndarray, kind: ActionKind, index: int, sequence: int) -> float:
        after_robot = self._drawn + NUM_ROBOT_DRAWS * self._m
        if kind == ActionKind.ROBOT_TASK:
            place = self._drawn + (sequence - 1) % NUM_ROBOT_DRAWS * self._m + index - 1
        else:
            # An aborted assistance homes from elsewhere, in the time drawn for homing.
            group = {
                ActionKind.PREPARE: 0,
                ActionKind.JOINT: 1,
                ActionKind.HOME: 2,
                ActionKind.HOME_ABORTED: 2,
            }
            place = after_robot + group[kind] * self._joints + index - 1
        drawn = float(state[place])
        # No motion is played faster than the arm's limits allow.
        return drawn if self._motions is None else max(drawn, self._motions.minimum_duration(kind, index))

    @staticmethod
    def _state(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _fraction(self, state: np.ndarray, time: float) -> float:
        if state[5] == 0:
            return 0.0
        spent = state[4] + (time - state[3] if state[6] else 0.0)
        return min(max(spent / state[5], 0.0), 1.0)

    def _is_done(self, context: Context) -> bool:
        """Whether the running motion has come to its end."""
        state = self._state(context)
        # The same expression as in next_event_time: stepping there makes it true, without rounding.
        if not state[6] or context.get_time() < state[3] + (state[5] - state[4]):
            return False
        if self._motions is None:
            return True
        target = self._motions.position(ActionKind(int(state[1])), int(state[2]), 1.0)
        return bool(np.max(np.abs(self._measured.Eval(context) - target)) <= self._tolerance)

    def _motion_done(self, context: Context) -> float:
        state = self._state(context)
        return state[0] if self._is_done(context) else state[7]

    def _busy(self, context: Context) -> float:
        return float(self._state(context)[6] == 1 and not self._is_done(context))

    def _progress(self, context: Context) -> tuple[float, float, float]:
        state = self._state(context)
        return state[1], state[2], self._fraction(state, context.get_time())

    def _next_event_time(self, context: Context) -> float:
        state = self._state(context)
        if not state[6]:
            return np.inf
        end = state[3] + (state[5] - state[4])
        return end if context.get_time() < end else context.get_time() + _ARRIVAL_POLL

    def _position(self, context: Context) -> np.ndarray:
        assert self._motions is not None
        state = self._state(context)
        if state[1] == ActionKind.NONE:
            return self._motions.home
        fraction = self._fraction(state, context.get_time())
        return self._motions.position(ActionKind(int(state[1])), int(state[2]), fraction)

    def _gripper(self, context: Context) -> float:
        assert self._motions is not None
        state = self._state(context)
        kind = ActionKind(int(state[1])) or ActionKind.ROBOT_TASK
        return self._motions.gripper_width(kind, int(state[2]) or 1, self._fraction(state, context.get_time()))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        kind_value, index, sequence = self._command.Eval(context)
        kind, time = ActionKind(int(kind_value)), context.get_time()
        done = self._is_done(context)
        x = values.get_mutable_value(0)
        if done:
            x[7], x[4], x[6] = x[0], x[5], 0.0
        if kind == ActionKind.HOLD:
            if x[6]:
                x[4] += time - x[3]
                x[6] = 0.0
            return
        if sequence == x[0] or kind == ActionKind.NONE:
            return
        unfinished = x[7] != x[0] and (x[1], x[2]) == (kind_value, index)
        if not unfinished:
            x[1], x[2], x[4] = kind_value, index, 0.0
            x[5] = self._duration(self._state(context), kind, int(index), int(sequence))
        x[0], x[3], x[6] = sequence, time, 1.0
