"""Receivers of the arm's and the gripper's status: what cannot be used never gets into the diagram."""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from drake import lcmt_panda_status, lcmt_schunk_wsg_status
from pydrake.systems.framework import Context

from pace_drake.lcm.inbox import Inbox
from pace_drake.lcm.inbox_receiver import COUNT, InboxReceiver
from pace_drake.lcm.link import Lcm
from pace_drake.ports import declare_output
from pace_drake.safety.joint_limits import NUM_JOINTS

#: Status messages over which the difference of the clocks is judged.
_NUM_SKEWS = 50
#: What a Franka Hand may report: widths [mm], with some leave, of which none but 0 is nearer to 0; speed [mm/s].
_WIDTHS, _LEAST_WIDTH, _LARGEST_SPEED = (-5.0, 90.0), 1e-12, 1e4
#: Places in the state of the arm's receiver.
_MODE, _SUCCESS = 2, 3
_POSITION, _VELOCITY, _TORQUE = slice(4, 11), slice(11, 18), slice(18, 25)
_SKEWS = slice(25, 25 + _NUM_SKEWS)


def _wrong_with_arm(status: Any) -> str:
    """What is wrong with an arm's status; empty if nothing is."""
    for name in ("joint_position", "joint_velocity", "joint_torque_external"):
        values = getattr(status, name)
        if len(values) != NUM_JOINTS:
            return f"{name} has {len(values)} joints instead of {NUM_JOINTS}"
        if not all(math.isfinite(value) for value in values):
            return f"{name} is not finite"
    return "" if math.isfinite(status.control_command_success_rate) else "control_command_success_rate is not finite"


def _wrong_with_gripper(status: Any) -> str:
    width, speed = status.actual_position_mm, status.actual_speed_mm_per_s
    if not (math.isfinite(width) and math.isfinite(speed)):
        return "position or speed is not finite"
    # Of noise read as a number, one in fifty is neither huge nor next to nothing, which no encoder says.
    plausible = width == 0.0 or (abs(width) >= _LEAST_WIDTH and _WIDTHS[0] <= width <= _WIDTHS[1])
    return "" if plausible and abs(speed) <= _LARGEST_SPEED else f"{width:g} mm at {speed:g} mm/s is no gripper's"


class PandaStatusReceiver(InboxReceiver):
    """The arm's newest ``lcmt_panda_status``.

    Duplicates, messages that are older than the newest, and bytes that are no status are dropped (see ``Inbox``). All
    outputs are zero before the first status, and status_age infinite. They depend on state and time only, so that all
    systems that read them at one instant agree.

    Outputs:
        position_measured (7) [rad], velocity_measured (7) [rad/s].
        torque_external (7) [Nm]: in Drake's sign, the opposite of the message's.
        robot_mode (1): libfranka's; 2 = Move.
        success_rate (1) [-]: share of the last hundred commands that the robot took in time.
        clock_skew (1) [s]: how far the clock of this machine is ahead of that which stamps the status. The least of the
            last fifty messages counts, as a late look makes it seem more.
        num_status (1): good messages so far.
        status_age (1) [s]: context time since the last of them was taken in.

    State:
        [count, arrival [s], mode, success rate, position (7), velocity (7), torque (7), skews (50) [s]].

    Events:
        update: at initialization and at every step.

    Args:
        lcm: where the status comes from.
        channel: its channel.
        clock: wall clock [s since the Unix epoch] of this machine.
    """

    def __init__(self, lcm: Lcm, channel: str = "PANDA_STATUS", clock: Callable[[], float] = time.time) -> None:
        initial = np.concatenate([np.zeros(_SKEWS.start - _MODE), np.full(_NUM_SKEWS, np.inf)])
        super().__init__(Inbox(lcm, channel, lcmt_panda_status, check=_wrong_with_arm), initial, "status_age")
        self._clock = clock
        for name, places in (
            ("num_status", slice(COUNT, COUNT + 1)),
            ("robot_mode", slice(_MODE, _MODE + 1)),
            ("success_rate", slice(_SUCCESS, _SUCCESS + 1)),
            ("position_measured", _POSITION),
            ("velocity_measured", _VELOCITY),
            ("torque_external", _TORQUE),
        ):
            self._declare(name, places)
        declare_output(self, "clock_skew", self._skew, {self.xd_ticket()})

    def _skew(self, context: Context) -> float:
        least = float(np.min(self._x(context)[_SKEWS]))
        return least if math.isfinite(least) else 0.0

    def _take(self, x: np.ndarray, message: Any) -> None:
        x[_MODE], x[_SUCCESS] = message.robot_mode, message.control_command_success_rate
        x[_POSITION], x[_VELOCITY] = message.joint_position, message.joint_velocity
        x[_TORQUE] = [-torque for torque in message.joint_torque_external]
        x[_SKEWS] = np.roll(x[_SKEWS], 1)
        x[_SKEWS.start] = self._clock() - 1e-6 * message.utime


class GripperStatusReceiver(InboxReceiver):
    """The gripper's newest ``lcmt_schunk_wsg_status``; see ``PandaStatusReceiver``.

    Outputs:
        state (2) [m, m/s]: width between the fingers and its rate.
        status_age (1) [s]: context time since the last good message was taken in; infinite before the first.

    State:
        [count, arrival [s], width [m], rate [m/s]].

    Events:
        update: at initialization and at every step.

    Args:
        lcm: where the status comes from.
        channel: its channel.
    """

    def __init__(self, lcm: Lcm, channel: str = "PANDA_HAND_STATUS") -> None:
        super().__init__(
            Inbox(lcm, channel, lcmt_schunk_wsg_status, check=_wrong_with_gripper), np.zeros(2), "status_age"
        )
        self._declare("state", slice(2, 4))

    def _take(self, x: np.ndarray, message: Any) -> None:
        x[2:] = 1e-3 * message.actual_position_mm, 1e-3 * message.actual_speed_mm_per_s
