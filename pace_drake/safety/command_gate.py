"""CommandGate: the one place through which every joint command passes before it is sent.

Numbers only, no Drake and no LCM: ``pace_drake.lcm.command_sender`` puts it into a system.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from enum import IntEnum
from math import ceil

import numpy as np

from pace_drake.safety.joint_limits import NUM_JOINTS, JointLimits


class GateMode(IntEnum):
    """What the gate does with the reference."""

    SILENT = 0
    """Sends nothing; the robot's driver holds the last position."""
    JOINING = 1
    """Leads the arm slowly from where it is to the reference."""
    FOLLOWING = 2
    """Sends the reference."""
    BRAKING = 3
    """Comes to rest on its own, and holds that position."""


class Refusal(IntEnum):
    """Why the gate does not follow the reference; NONE if it does, or was never asked to."""

    NONE = 0
    NOT_FINITE = 1
    POSITION = 2
    VELOCITY = 3
    ACCELERATION = 4
    JERK = 5
    TOO_FAR = 6
    OBSTRUCTED = 7


#: [s] that the arm has to catch up with the position at which the gate has come to rest.
SETTLING_TIME = 0.5
#: The share of the acceleration limit with which the gate brakes.
BRAKING_SHARE = 0.5
#: What rounding may add to a limit, as a share of it.
_SLACK = 1e-6


_NUM_SCALARS = 9


def _zeros() -> np.ndarray:
    return np.zeros(NUM_JOINTS)


@dataclass(frozen=True)
class GateInput:
    """What the gate sees at one tick."""

    reference: np.ndarray
    """(7) [rad] where the arm is asked to be."""
    measured: np.ndarray
    """(7) [rad] where it is."""
    ready: bool
    """Whether the status is fresh and the robot in Move mode: only then anything is sent."""
    fault: bool
    """Whether it must brake."""
    enable: bool
    """The operator's leave to move; its rising edge counts."""
    lost: bool = False
    """Whether so much time has been lost since the last tick that a moving arm has come to rest meanwhile."""


@dataclass(frozen=True)
class GateState:
    """What the gate remembers from tick to tick; ``vector`` and ``from_vector`` lay it out flat."""

    mode: GateMode = GateMode.SILENT
    refusal: Refusal = Refusal.NONE
    """of the last command that was refused since the last join began."""
    joint: int = 0
    """[1-based] of that refusal; 0 none."""
    num_refusals: int = 0
    num_losses: int = 0
    """How often time was lost while the arm moved."""
    enable: bool = False
    """At the last tick."""
    armed: bool = False
    """Whether leave was given and not used yet."""
    step: int = 0
    """Ticks that the join or the braking and holding have taken."""
    steps: int = 0
    """Ticks that the join or the braking takes."""
    position: np.ndarray = field(default_factory=_zeros)
    """(7) [rad] sent last."""
    velocity: np.ndarray = field(default_factory=_zeros)
    """(7) [rad/s] between the last two sent."""
    acceleration: np.ndarray = field(default_factory=_zeros)
    """(7) [rad/s^2] likewise."""
    start: np.ndarray = field(default_factory=_zeros)
    """(7) [rad] where the join began, or [rad/s] with what velocity the braking began."""
    end: np.ndarray = field(default_factory=_zeros)
    """(7) [rad] where the join ends."""

    def vector(self) -> np.ndarray:
        """(44) all fields."""
        scalars = [getattr(self, f.name) for f in fields(self)[:_NUM_SCALARS]]
        arrays = [getattr(self, f.name) for f in fields(self)[_NUM_SCALARS:]]
        return np.concatenate([np.array(scalars, dtype=float), *arrays])

    @staticmethod
    def from_vector(vector: np.ndarray) -> "GateState":
        """The state that ``vector`` laid out."""
        mode, refusal, joint, num_refusals, num_losses, enable, armed, step, steps = map(int, vector[:_NUM_SCALARS])
        arrays = vector[_NUM_SCALARS:].reshape(-1, NUM_JOINTS).copy()
        return GateState(
            GateMode(mode),
            Refusal(refusal),
            joint,
            num_refusals,
            num_losses,
            bool(enable),
            bool(armed),
            step,
            steps,
            *arrays,
        )


@dataclass(frozen=True, kw_only=True)
class CommandGate:
    """Passes joint positions on, one each tick, such that nothing it sends is outside the limits.

    It begins silent. With the operator's leave it leads the arm from where it is measured to the reference, slowly and
    on a straight line in joint space (minimum jerk), and then follows the reference. Each command must be finite, so
    that the arm could stop within its position limits, and within the limits of velocity, acceleration and jerk from
    the commands before it. One that is not is refused before it is sent: the gate brakes and holds. So it does when
    there is a fault. When the robot does not listen, or time was lost while it moved, it falls silent. Only the
    operator's leave gets it going again, from where the arm is then.

    The first command after silence is the measured position.
    """

    limits: JointLimits
    """of the arm."""
    period: float
    """[s] between two ticks."""
    margin: float = 0.02
    """[rad] kept from the position limits."""
    tolerance: float = 0.01
    """[rad] by which the measured position may differ from what is held for a join to begin from the latter."""
    join_speed: float = 0.1
    """[-] share of the velocity limits with which the arm is led to the reference."""
    join_range: float = 1.0
    """[rad] largest way of a joint to the reference."""
    is_free: Callable[[np.ndarray, np.ndarray], bool] = lambda start, end: True
    """Whether the straight way between two positions (7) [rad] is free of obstacles."""

    def tick(self, state: GateState, seen: GateInput) -> GateState:
        """The state after one tick; if its mode is not SILENT, its position is to be sent."""
        armed = seen.enable and (state.armed or not state.enable)
        state = replace(state, enable=seen.enable, armed=armed)
        if seen.lost and state.mode != GateMode.SILENT and np.any(state.velocity):
            # To go on would be to command full speed to an arm at rest.
            return self._silent(replace(state, num_losses=state.num_losses + 1))
        if not seen.ready or state.mode == GateMode.SILENT:
            state = self._silent(state)
            may_join = seen.ready and seen.enable and armed and not seen.fault
            return self._join(state, seen.measured, seen.reference) if may_join else state
        if state.mode == GateMode.BRAKING:
            return self._keep_braking(state, seen)
        if seen.fault:
            return self._brake(state)
        if state.mode == GateMode.JOINING:
            return self._keep_joining(state, seen)
        return self._follow(state, seen.reference)

    # ---- the modes

    @staticmethod
    def _silent(state: GateState) -> GateState:
        return replace(state, mode=GateMode.SILENT, velocity=_zeros(), acceleration=_zeros())

    def _follow(self, state: GateState, reference: np.ndarray) -> GateState:
        refusal, joint = self._examine(state, reference)
        if refusal:
            return self._brake(_refused(state, refusal, joint))
        return self._sent(replace(state, mode=GateMode.FOLLOWING), reference)

    def _join(self, state: GateState, start: np.ndarray, end: np.ndarray) -> GateState:
        """Begins a join at ``start``, which is sent; where it cannot, the mode stays."""
        state = replace(state, armed=False)
        refusal, joint = self._examine_way(start, end)
        if refusal:
            return _refused(state, refusal, joint)
        way, limits = np.abs(end - start), self.limits
        # Peaks of the minimum-jerk course over a time T: 1.875 way / T, 5.774 way / T^2, 60 way / T^3.
        duration = max(
            np.max(1.875 * way / (self.join_speed * limits.velocity)),
            np.max(np.sqrt(5.774 * way / (self.join_speed * limits.acceleration))),
            np.max(np.cbrt(60.0 * way / (self.join_speed * limits.jerk))),
        )
        return replace(
            state,
            mode=GateMode.JOINING,
            refusal=Refusal.NONE,
            joint=0,
            step=0,
            steps=max(ceil(duration / self.period), 1),
            position=start,
            velocity=_zeros(),
            acceleration=_zeros(),
            start=start,
            end=end,
        )

    def _keep_joining(self, state: GateState, seen: GateInput) -> GateState:
        if state.step < state.steps:
            s = (state.step + 1) / state.steps
            position = state.start + (state.end - state.start) * s**3 * (10 - 15 * s + 6 * s**2)
            return self._sent(replace(state, step=state.step + 1), position)
        # At the end of the way; the reference may have moved on meanwhile.
        if np.all(np.isfinite(seen.reference)) and np.max(np.abs(seen.reference - state.position)) > _SLACK:
            again = self._join(state, state.position, seen.reference)
            return again if again.num_refusals == state.num_refusals else self._brake(again)
        return self._follow(state, seen.reference)

    def _brake(self, state: GateState) -> GateState:
        duration = np.max(np.abs(state.velocity) / (BRAKING_SHARE * self.limits.acceleration))
        steps = ceil(duration / self.period)
        return self._slow_down(replace(state, mode=GateMode.BRAKING, step=0, steps=steps, start=state.velocity))

    def _slow_down(self, state: GateState) -> GateState:
        braking = replace(state, step=state.step + 1)
        if state.step >= state.steps:
            return self._sent(braking, state.position)
        velocity = state.start * (1.0 - braking.step / state.steps)
        return self._sent(braking, state.position + velocity * self.period)

    def _keep_braking(self, state: GateState, seen: GateInput) -> GateState:
        settled = (state.step - state.steps) * self.period >= SETTLING_TIME
        if settled and not np.max(np.abs(seen.measured - state.position)) <= self.tolerance:
            # What is held and where the arm is have parted: commands must begin anew from the measured position.
            return self._silent(state)
        if settled and state.armed and not seen.fault:
            joining = self._join(state, state.position, seen.reference)
            return joining if joining.mode == GateMode.JOINING else self._slow_down(joining)
        return self._slow_down(state)

    # ---- what may be sent

    def _sent(self, state: GateState, position: np.ndarray) -> GateState:
        velocity = (position - state.position) / self.period
        acceleration = (velocity - state.velocity) / self.period
        return replace(state, position=position, velocity=velocity, acceleration=acceleration)

    def _examine(self, state: GateState, position: np.ndarray) -> tuple[Refusal, int]:
        """Why ``position`` (7) [rad] may not be sent next, and the joint [1-based]."""
        if not np.all(np.isfinite(position)):
            return Refusal.NOT_FINITE, int(np.argmin(np.isfinite(position))) + 1
        limits = self.limits
        velocity = (position - state.position) / self.period
        acceleration = (velocity - state.velocity) / self.period
        jerk = (acceleration - state.acceleration) / self.period
        for excess, refusal in (
            (np.abs(velocity) - limits.velocity * (1 + _SLACK), Refusal.VELOCITY),
            (np.abs(acceleration) - limits.acceleration * (1 + _SLACK), Refusal.ACCELERATION),
            (np.abs(jerk) - limits.jerk * (1 + _SLACK), Refusal.JERK),
            (self._beyond(position, velocity), Refusal.POSITION),
        ):
            if np.any(excess > 0):
                return refusal, int(np.argmax(excess)) + 1
        return Refusal.NONE, 0

    def _beyond(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """(7) [rad] how far beyond the position limits the arm would come, if it braked from here on."""
        way = velocity * np.abs(velocity) / (2 * BRAKING_SHARE * self.limits.acceleration)
        return np.max([self.limits.beyond(at, self.margin) for at in (position, position + way)], axis=0)

    def _examine_way(self, start: np.ndarray, end: np.ndarray) -> tuple[Refusal, int]:
        """Why the arm may not be led from ``start`` to ``end``, each (7) [rad]."""
        if not (np.all(np.isfinite(start)) and np.all(np.isfinite(end))):
            return Refusal.NOT_FINITE, int(np.argmin(np.isfinite(start) & np.isfinite(end))) + 1
        way = np.abs(end - start)
        if np.max(way) > self.join_range:
            return Refusal.TOO_FAR, int(np.argmax(way)) + 1
        for position in (start, end):
            beyond = self._beyond(position, np.zeros(NUM_JOINTS))
            if np.any(beyond > 0):
                return Refusal.POSITION, int(np.argmax(beyond)) + 1
        return (Refusal.NONE, 0) if self.is_free(start, end) else (Refusal.OBSTRUCTED, 0)


def _refused(state: GateState, refusal: Refusal, joint: int) -> GateState:
    return replace(state, refusal=refusal, joint=joint, num_refusals=state.num_refusals + 1)
