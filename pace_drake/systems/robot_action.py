"""RobotAction: carries out what the statechart commands, one motion per command."""

from dataclasses import dataclass
from math import atan2
from typing import Protocol

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.ports import declare_input, declare_output, declare_update
from pace_drake.systems.path_clock import PathClock
from pace_drake.task import NUM_ROBOT_DRAWS, ActionKind, Episode, Task

#: [s] how soon an arm that has not arrived at the end of its motion is looked at again.
_ARRIVAL_POLL = 0.01

#: [s] in which the path rate falls from 1 to 0, unless told otherwise.
STOP_TIME = 0.25

#: Places in the state; the drawn durations follow.
_SEQUENCE, _KIND, _INDEX, _DURATION, _SINCE, _PATH, _RATE, _AIM, _ACTIVE, _LAST_DONE, _HELD = range(11)
_LOCATED, _RELEASED, _BACK, _NUM_LOST, _DRAWN = slice(11, 14), 14, 15, 16, 17
#: Of a ``PathClock``, in its order; the first of them stays as it is while a motion goes on.
_CLOCK, _LED = slice(_DURATION, _AIM + 1), slice(_SINCE, _AIM + 1)

_JOINT = float(ActionKind.JOINT)
#: [s] between two looks at whether the person's hand has what is held out to it.
_HAND_PERIOD = 0.01
#: [s] how old the place of a component may be for a motion to begin that fetches it.
MAX_COMPONENT_AGE = 1.0


class HandOver(Protocol):
    """As ``pace_drake.stations.motions.HandOver``."""

    @property
    def offered(self) -> float:
        """[-] share of the motion after which the thing is held out."""

    @property
    def p_WH(self) -> np.ndarray:
        """(3) [m] where the hand takes it."""

    @property
    def reach(self) -> float:
        """[m] within which of that place the hand has it."""

    @property
    def speed(self) -> float:
        """[m/s] at which the gripper opens."""

    @property
    def width(self) -> float:
        """[m] to which it opens."""


#: Postures along the path ahead that are put out for a monitor, the present one included.
NUM_POSTURES = 6


@dataclass(frozen=True, kw_only=True)
class Pacing:
    """How a monitor outside leads the rate at which paths are passed."""

    period: float
    """[s] between two looks at the input ``speed_scale``."""
    look_ahead: float
    """[s] of the path, passed at rate 1, that is put out."""


@dataclass(frozen=True, kw_only=True)
class LetGo:
    """How the gripper opens while the arm goes back for what was lost."""

    speed: float
    """[m/s]"""
    width: float
    """[m] to which it opens, if the motion has it no wider there."""


class Motion(Protocol):
    """As ``pace_drake.stations.motions.Motion``; a fraction is a share of the motion's time, clamped to [0, 1]."""

    @property
    def duration(self) -> float:
        """[s] within the joint limits."""

    @property
    def hand_over(self) -> HandOver | None:
        """How what is held out is let go; None where the gripper opens by the clock."""

    def position(self, fraction: float) -> np.ndarray:
        """(7) [rad] joint positions after ``fraction`` of the motion."""

    def path_positions(self, fractions: np.ndarray) -> np.ndarray:
        """(n, 7) [rad] joint positions after fractions (n) of the motion."""

    def path_velocities(self, fractions: np.ndarray) -> np.ndarray:
        """(n, 7) [rad/s] joint velocities there, played in ``duration``; 0 outside [0, 1]."""

    def gripper_width(self, fraction: float) -> float:
        """[m]."""


class Motions(Protocol):
    """Planned motions, as ``pace_drake.stations.motions.MotionLibrary`` offers them."""

    @property
    def home(self) -> np.ndarray:
        """(7) [rad] where robot tasks begin and end."""

    def component(self, kind: ActionKind, index: int) -> int | None:
        """Which component the action fetches; None if none."""

    def motion(self, kind: ActionKind, index: int, located: np.ndarray | None = None) -> Motion:
        """The motion of an action; ``located`` (3) is where what it fetches lies: x [m], y [m], yaw [rad]."""


class RobotAction(LeafSystem):
    """Turns commands into timed motions; holds on HOLD and goes on where it was when the command is issued again.

    A command is new when its sequence number is. ``motion_done`` is the sequence number of the last finished command,
    so that a late reader can neither miss nor repeat one (docs/statechart.md). Holding and going on scale the time in
    which the path is passed, down to 0 and up to 1 again: the arm stays on its path and never jumps in velocity. With
    a ``Pacing`` a monitor leads the rate in the same way to anything between 0 and 1. Where it asks for less right
    after a motion has begun, the rate need not fall gradually: the arm hardly moves yet.

    A motion that fetches something begins when the component has been located within ``MAX_COMPONENT_AGE``, and leads
    to where it was then. What is held out is let go when the person's hand has it, and only then the motion is done.

    With a ``LetGo``, a motion that fetches and has lost what it fetched is not done. Issued again, it opens the
    gripper, goes back on its path to where it began, and begins anew from there. Other motions go on without it.

    Inputs:
        robot_action (3): kind, index, sequence number.
        position_measured (7) [rad]: only with motions; a motion is done when its time is over and the arm is there.
        component_poses (7 n), component_ages (n) [s]: only with motions; quaternion w, x, y, z and position [m] of each
            component, and how long ago it was there.
        p_WH (3) [m]: only with motions; the person's hand.
        speed_scale (1) [-]: only with a pacing; path rate in [0, 1] to aim at where nothing is held.
        num_lost (1): only with a let_go; how often something was found lost from the gripper.

    Outputs:
        motion_done (1): sequence number of the last finished command; 0 before the first.
        robot_busy (1): 1 while the robot moves.
        motion_progress (3): kind, index, fraction in [0, 1] of the motion that runs or ran last.
        next_event_time (1) [s]: when motion_done or robot_busy change next; inf if nothing runs.
        position (7) [rad], gripper_position (1) [m]: only with motions; the home position before the first command.
        path_rate (1) [-]: only with a pacing; rate at which the path is passed, 0 when nothing is active.
        path_position (NUM_POSTURES * 7) [rad], path_velocity (NUM_POSTURES * 7) [rad/s]: only with a pacing; joint
            positions, and velocities at path rate 1, now and evenly along the path ahead; velocities are zero when
            nothing is active.
        to_locate (3): only with a let_go; the command for whose motion something must be located: robot_action, or of
            kind NONE while the arm goes back, and then with a number that is half more, so that it is looked for anew.

    State:
        [sequence, kind, index, duration [s], time of the last update of the path's clock [s], path time then [s], path
        rate then [-], path rate aimed at [-], active (not finished), last done, held, x, y [m] and yaw [rad] of what is
        fetched, time at which it was let go [s] (negative: it was not), path time from which the arm goes back [s] (0:
        it goes forward), num_lost when a command was taken last, robot-task durations (NUM_ROBOT_DRAWS * M) [s],
        preparation (L), joint (L), homing (L) [s]]. While the arm goes back, the path's clock is that of the way back.

    Events:
        update: takes a new command, holds, or goes on (forced or periodic).
        periodic (10 ms), only with motions: looks whether the hand has what is held out, and changes nothing else.
        periodic, only with a pacing: aims at another rate if ``speed_scale`` has changed, and changes nothing else.

    Args:
        task: a validated task.
        motions: planned motions, or None at the task level, where actions only take time and stop at once.
        num_components: n; only with motions.
        arrival_tolerance: [rad] largest joint error at which a motion counts as done.
        stop_time: [s] in which the path rate falls from 1 to 0, and rises again; only with motions.
        pacing: lets a monitor lead the path rate; only with motions.
        let_go: lets a monitor say that something was lost; only with motions.
        reaction_period: see ``declare_update``.
    """

    def __init__(
        self,
        task: Task,
        motions: Motions | None = None,
        num_components: int = 0,
        arrival_tolerance: float = 0.05,
        stop_time: float = STOP_TIME,
        pacing: Pacing | None = None,
        let_go: LetGo | None = None,
        reaction_period: float | None = None,
    ) -> None:
        super().__init__()
        self.set_name("robot_action")
        self._m, self._joints = task.num_robot_tasks, task.num_joint_actions
        self._alpha = task.human_index_of_joint
        self._motions = motions
        self._tolerance = arrival_tolerance
        self._stop_time = 0.0 if motions is None else stop_time
        self.DeclareDiscreteState(_DRAWN + NUM_ROBOT_DRAWS * self._m + 3 * self._joints)
        self._command = declare_input(self, "robot_action", 3)
        now = {self.xd_ticket(), self.time_ticket()}
        arrival = set(now)
        if motions is not None:
            self._measured = declare_input(self, "position_measured", 7)
            arrival.add(self.input_port_ticket(self._measured.get_index()))
            self._poses = declare_input(self, "component_poses", 7 * num_components)
            self._ages = declare_input(self, "component_ages", num_components)
            self._hand = declare_input(self, "p_WH", 3)
            self.DeclarePeriodicDiscreteUpdateEvent(_HAND_PERIOD, 0.0, self._watch_hand)
            declare_output(self, "position", self._position, now, size=7)
            declare_output(self, "gripper_position", self._gripper, now)
        self._pacing = pacing
        if pacing is not None:
            assert motions is not None, "only planned motions have a pace"
            self._scale = declare_input(self, "speed_scale")
            self._ahead = np.linspace(0.0, pacing.look_ahead, NUM_POSTURES)
            declare_output(self, "path_rate", self._path_rate, now)
            declare_output(self, "path_position", self._path_position, now, size=7 * NUM_POSTURES)
            declare_output(self, "path_velocity", self._path_velocity, now, size=7 * NUM_POSTURES)
            self.DeclarePeriodicDiscreteUpdateEvent(pacing.period, 0.0, self._follow_scale)
        self._let_go = let_go
        if let_go is not None:
            assert motions is not None, "only planned motions hold something"
            self._lost = declare_input(self, "num_lost")
            arrival.add(self.input_port_ticket(self._lost.get_index()))
            commanded = {*now, self.input_port_ticket(self._command.get_index())}
            declare_output(self, "to_locate", self._to_locate, commanded, size=3)
        declare_output(self, "motion_done", self._motion_done, arrival)
        declare_output(self, "robot_busy", self._busy, arrival)
        declare_output(self, "motion_progress", self._progress, now, size=3)
        declare_output(self, "next_event_time", self._next_event_time, now)
        declare_update(self, self._update, reaction_period)

    def set_episode(self, context: Context, episode: Episode) -> None:
        """Puts the drawn durations into the context; no command has been taken yet."""
        self.set_durations(context, episode, episode.human[[j - 1 for j in self._alpha]])

    def set_durations(self, context: Context, episode: Episode, joint: np.ndarray) -> None:
        """As ``set_episode``, but the robot takes (L) [s] of its own in the joint actions."""
        context.SetDiscreteState(
            np.concatenate(
                [
                    np.zeros(_RELEASED),
                    [-1.0, 0.0, 0.0],
                    episode.robot.ravel(),
                    episode.preparation,
                    joint,
                    episode.homing,
                ]
            )
        )

    def _drawn_duration(
        self, state: np.ndarray, kind: ActionKind, index: int, sequence: int, located: np.ndarray
    ) -> float:
        if kind == ActionKind.ROBOT_TASK:
            place = (sequence - 1) % NUM_ROBOT_DRAWS * self._m + index - 1
        else:
            # An aborted assistance homes from elsewhere, in the time drawn for homing.
            group = {ActionKind.PREPARE: 0, ActionKind.JOINT: 1, ActionKind.HOME: 2, ActionKind.HOME_ABORTED: 2}
            place = NUM_ROBOT_DRAWS * self._m + group[kind] * self._joints + index - 1
        drawn = float(state[_DRAWN + place])
        # No motion is played faster than the arm's limits allow.
        return drawn if self._motions is None else max(drawn, self._motions.motion(kind, index, located).duration)

    def _motion(self, state: np.ndarray) -> Motion:
        """The motion that runs or ran last."""
        assert self._motions is not None
        # An ActionKind is its number, and several times slower to make.
        return self._motions.motion(int(state[_KIND]), int(state[_INDEX]), state[_LOCATED])  # type: ignore[arg-type]

    # ---- the path's clock

    def _clock(self, state: np.ndarray) -> PathClock:
        clock = PathClock._make((*state[_CLOCK].tolist(), self._stop_time))
        return clock._replace(duration=state[_BACK]) if state[_BACK] else clock

    def _passed(self, state: np.ndarray, time: float) -> tuple[float, float]:
        """(time of the path's clock [s], path rate) at ``time``."""
        return self._clock(state).at(time) if state[_ACTIVE] else (state[_PATH], 0.0)

    def _path_time(self, state: np.ndarray, time: float) -> float:
        """[s] along the path at ``time``."""
        passed = self._passed(state, time)[0]
        return state[_BACK] - passed if state[_BACK] else passed

    def _is_back(self, context: Context) -> bool:
        """Whether the arm has gone back to where the motion began."""
        state = self._state(context)
        return bool(state[_BACK]) and context.get_time() >= self._clock(state).end

    def _has_lost(self, context: Context) -> bool:
        """Whether the active motion has lost what it fetches."""
        state = self._state(context)
        if self._let_go is None or not state[_ACTIVE] or self._lost.Eval(context)[0] == state[_NUM_LOST]:
            return False
        assert self._motions is not None
        return self._motions.component(ActionKind(int(state[_KIND])), int(state[_INDEX])) is not None

    def _is_done(self, context: Context) -> bool:
        """Whether the active motion has come to its end."""
        state = self._state(context)
        # The same expression as in next_event_time: stepping there makes it true, without rounding.
        if not state[_ACTIVE] or context.get_time() < self._clock(state).end:
            return False
        if self._motions is None:
            return True
        if state[_BACK] or self._has_lost(context):
            return False
        motion = self._motion(state)
        hand_over = motion.hand_over
        if hand_over is not None and self._opened(state, hand_over, context.get_time()) < hand_over.width:
            return False
        target = motion.position(1.0)
        return bool(np.max(np.abs(self._measured.Eval(context) - target)) <= self._tolerance)

    # ---- outputs

    @staticmethod
    def _state(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _motion_done(self, context: Context) -> float:
        state = self._state(context)
        return state[_SEQUENCE] if self._is_done(context) else state[_LAST_DONE]

    def _busy(self, context: Context) -> float:
        state = self._state(context)
        clock = self._clock(state)
        moving = clock.aim or context.get_time() < clock.since + clock.ramp
        return float(bool(state[_ACTIVE] and moving and not self._is_done(context)))

    def _fraction(self, context: Context) -> float:
        state = self._state(context)
        return self._path_time(state, context.get_time()) / state[_DURATION] if state[_DURATION] else 0.0

    def _progress(self, context: Context) -> tuple[float, float, float]:
        state = self._state(context)
        return state[_KIND], state[_INDEX], self._fraction(context)

    def _next_event_time(self, context: Context) -> float:
        state, time = self._state(context), context.get_time()
        if not state[_ACTIVE]:
            return np.inf
        clock = self._clock(state)
        end, at_rest = clock.end, clock.since + clock.ramp
        if time < end:
            return at_rest if not clock.aim and time < at_rest < end else end
        return time + _ARRIVAL_POLL

    def _position(self, context: Context) -> np.ndarray:
        assert self._motions is not None
        state = self._state(context)
        if not state[_KIND]:
            return self._motions.home
        return self._motion(state).position(self._fraction(context))

    def _gripper(self, context: Context) -> float:
        assert self._motions is not None
        state = self._state(context)
        if not state[_KIND]:
            return self._motions.motion(ActionKind.ROBOT_TASK, 1).gripper_width(0.0)
        motion = self._motion(state)
        width = motion.gripper_width(self._fraction(context))
        opening = self._let_go if state[_BACK] else motion.hand_over
        return width if opening is None else max(width, self._opened(state, opening, context.get_time()))

    def _to_locate(self, context: Context) -> np.ndarray:
        kind, index, sequence = self._command.Eval(context)
        if not self._state(context)[_BACK]:
            return np.array([kind, index, sequence])
        return np.array([kind, index, sequence + 0.5]) if self.begins(context) else np.zeros(3)

    @staticmethod
    def _opened(state: np.ndarray, opening: HandOver | LetGo, time: float) -> float:
        """[m] width of the gripper that lets go; 0 before."""
        if state[_RELEASED] < 0:
            return 0.0
        return min(opening.speed * (time - state[_RELEASED]), opening.width)

    # ---- the path ahead

    def _path_rate(self, context: Context) -> float:
        return self._passed(self._state(context), context.get_time())[1]

    @staticmethod
    def _direction(state: np.ndarray) -> float:
        """-1 while the arm goes back, else 1."""
        return -1.0 if state[_BACK] else 1.0

    def _path_ahead(self, context: Context) -> np.ndarray:
        """Fractions of the motion, now and ahead."""
        state = self._state(context)
        return (self._path_time(state, context.get_time()) + self._direction(state) * self._ahead) / state[_DURATION]

    def _path_position(self, context: Context) -> np.ndarray:
        state = self._state(context)
        if not state[_ACTIVE]:
            return np.tile(self._position(context), NUM_POSTURES)
        return self._motion(state).path_positions(self._path_ahead(context)).ravel()

    def _path_velocity(self, context: Context) -> np.ndarray:
        state = self._state(context)
        if not state[_ACTIVE]:
            return np.zeros(7 * NUM_POSTURES)
        motion = self._motion(state)
        rate = self._direction(state) * motion.duration / state[_DURATION]
        return (rate * motion.path_velocities(self._path_ahead(context))).ravel()

    # ---- update

    def _aim(self, context: Context) -> float:
        """The path rate aimed at where nothing is held."""
        return 1.0 if self._pacing is None else float(np.clip(self._scale.Eval(context)[0], 0.0, 1.0))

    def _follow_scale(self, context: Context, values: DiscreteValues) -> None:
        before, time, aim = self._state(context), context.get_time(), self._aim(context)
        if not before[_ACTIVE] or before[_HELD] or aim == before[_AIM]:
            return
        assert self._pacing is not None
        clock = self._clock(before).led(time, aim)
        if clock.passed <= self._pacing.period:
            clock = clock._replace(rate=min(clock.rate, aim))
        values.get_mutable_value(0)[_LED] = clock[1:-1]

    def _update(self, context: Context, values: DiscreteValues) -> None:
        kind_value, index, sequence = self._command.Eval(context)
        kind, time = ActionKind(int(kind_value)), context.get_time()
        before = self._state(context)
        x = values.get_mutable_value(0)
        if self._is_done(context):
            x[_LAST_DONE], x[_PATH], x[_ACTIVE] = x[_SEQUENCE], x[_DURATION], 0.0
        if kind == ActionKind.HOLD:
            if x[_ACTIVE] and not x[_HELD]:
                x[_LED], x[_HELD] = self._clock(before).led(time, 0.0)[1:-1], 1.0
            return
        begins = self.begins(context)
        if kind == ActionKind.NONE or (sequence == x[_SEQUENCE] and begins is None):
            return
        aim = self._aim(context)
        if begins is None and not before[_BACK] and self._has_lost(context):
            # The chart issues it again when the arm is at rest.
            x[_BACK], x[_PATH], x[_RATE], x[_RELEASED] = self._path_time(before, time), 0.0, 0.0, time
        elif begins is None:
            x[_PATH], x[_RATE] = self._passed(before, time)
        else:
            located = self._locate(context, kind, int(index))
            if located is None:
                return
            # A new motion begins at rest by itself: its clock need not start slowly.
            x[_KIND], x[_INDEX], x[_PATH], x[_RATE] = kind_value, index, 0.0, aim
            x[_LOCATED], x[_RELEASED], x[_BACK] = located, -1.0, 0.0
            x[_DURATION] = self._drawn_duration(before, kind, int(index), int(sequence), located)
        x[_SEQUENCE], x[_SINCE], x[_AIM], x[_ACTIVE], x[_HELD] = sequence, time, aim, 1.0, 0.0
        if self._let_go is not None:
            x[_NUM_LOST] = self._lost.Eval(context)[0]

    @staticmethod
    def clock_time(context: Context) -> float:
        """[s] when the path's clock was last set: a motion began, or its pace was changed."""
        return context.get_discrete_state_vector().GetAtIndex(_SINCE)

    def begins(self, context: Context) -> tuple[ActionKind, int, int] | None:
        """(kind, index, sequence) of the motion that an update now would begin anew; None if it would not."""
        kind, index, sequence = (int(value) for value in self._command.Eval(context))
        state = self._state(context)
        if kind in (ActionKind.NONE, ActionKind.HOLD):
            return None
        if self._is_back(context):
            return ActionKind(kind), index, sequence
        if sequence == state[_SEQUENCE]:
            return None
        if state[_ACTIVE] and not self._is_done(context) and (state[_KIND], state[_INDEX]) == (kind, index):
            return None
        return ActionKind(kind), index, sequence

    def _locate(self, context: Context, kind: ActionKind, index: int) -> np.ndarray | None:
        """(3) x [m], y [m], yaw [rad] of what the motion fetches (zeros where it fetches nothing); None: not seen."""
        number = None if self._motions is None else self._motions.component(kind, index)
        if number is None:
            return np.zeros(3)
        if self._ages.Eval(context)[number] > MAX_COMPONENT_AGE:
            return None
        w, x, y, z, *p_WO = self._poses.Eval(context)[7 * number : 7 * number + 7]
        return np.array([p_WO[0], p_WO[1], atan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)])

    def _watch_hand(self, context: Context, values: DiscreteValues) -> None:
        """Lets go of what the person has."""
        state = self._state(context)
        if state[_KIND] != _JOINT or not state[_ACTIVE] or state[_HELD] or state[_RELEASED] >= 0:
            return
        hand_over = self._motion(state).hand_over
        if hand_over is None or self._fraction(context) < hand_over.offered:
            return
        if np.linalg.norm(self._hand.Eval(context) - hand_over.p_WH) <= hand_over.reach:
            values.get_mutable_vector().SetAtIndex(_RELEASED, context.get_time())
