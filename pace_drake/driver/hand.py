"""HandDriver: opens and closes the hand on PANDA_HAND_COMMAND and reports on PANDA_HAND_STATUS."""

import dataclasses as dc
import math
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from drake import lcmt_schunk_wsg_command, lcmt_schunk_wsg_status

from pace_drake.driver.fer import import_libfranka
from pace_drake.driver.fr3 import one_line
from pace_drake.driver.robot import ConnectionLost, MotionAborted
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.inbox import Inbox
from pace_drake.lcm.link import Lcm

_PERIOD = 0.1  # [s] of the loop
_SPEED = 0.1  # [m/s] of the fingers
_LARGEST_WIDTH = 0.08  # [m]
_LARGEST_FORCE = 140.0  # [N]
_RECONNECT = 2.0  # [s]


@dc.dataclass(frozen=True)
class HandState:
    """What a hand says of itself."""

    width: float  # [m] between the fingers
    grasped: bool


class Hand(Protocol):
    """A hand with two fingers. All methods raise ConnectionLost; `move` and `grasp` MotionAborted as well."""

    def connect(self) -> None:
        """Connects."""

    def read(self) -> HandState:
        """Returns the state."""

    def move(self, width: float, speed: float) -> None:
        """Goes to a width [m] at a speed [m/s]; returns when it is there, or has been stopped."""

    def grasp(self, width: float, speed: float, force: float) -> None:
        """Closes to a width [m] at a speed [m/s] and grasps with a force [N] what is in between; returns when done."""

    def stop(self) -> None:
        """Stops a motion in another thread."""


class FrankaHand:
    """The Franka Hand of either robot, through panda-python (the hand's protocol, version 3, is the same for both).

    pylibfranka would do as well, but it holds Python's lock while the fingers move, for up to a second, during which
    the arm gets no commands.
    """

    def __init__(self, ip: str) -> None:
        """Imports the package.

        Args:
            ip: address of the robot.

        Raises:
            InputError: the package is absent.
        """
        self._package, self._ip = import_libfranka(), ip
        self._hand: Any = None

    def connect(self) -> None:
        """See ``Hand``."""
        try:
            self._hand = self._package.Gripper(self._ip)
        except RuntimeError as error:
            raise ConnectionLost(one_line(error)) from error

    def read(self) -> HandState:
        """See ``Hand``."""
        try:
            state = self._hand.read_once()
        except RuntimeError as error:
            raise ConnectionLost(one_line(error)) from error
        return HandState(state.width, state.is_grasped)

    def move(self, width: float, speed: float) -> None:
        """See ``Hand``."""
        self._do(lambda: self._hand.move(width, speed))

    def grasp(self, width: float, speed: float, force: float) -> None:
        """See ``Hand``."""
        # Whatever it holds in the end, the width is not what was asked for: any is a grasp.
        self._do(lambda: self._hand.grasp(width, speed, force, _LARGEST_WIDTH, _LARGEST_WIDTH))

    def stop(self) -> None:
        """See ``Hand``."""
        self._do(lambda: self._hand.stop())

    def _do(self, call: Callable[[], bool]) -> None:
        try:
            call()
        except RuntimeError as error:
            raise MotionAborted(one_line(error)) from error


class SimulatedHand:
    """No hand at all: it says that it goes where it is told to, at the speed it is told."""

    def __init__(self, width: float = _LARGEST_WIDTH) -> None:
        """Starts at a width [m]."""
        self._width, self._stop = width, threading.Event()

    def connect(self) -> None:
        """See ``Hand``."""

    def read(self) -> HandState:
        """See ``Hand``."""
        return HandState(self._width, False)

    def move(self, width: float, speed: float) -> None:
        """See ``Hand``."""
        self._stop.clear()
        step = 0.01  # [s]
        while self._width != width and not self._stop.wait(step):
            self._width += min(max(width - self._width, -speed * step), speed * step)

    def grasp(self, width: float, speed: float, force: float) -> None:
        """See ``Hand``."""
        self.move(width, speed)

    def stop(self) -> None:
        """See ``Hand``."""
        self._stop.set()


class HandDriver:
    """Moves a hand as commanded and publishes its state, at 10 Hz: opening is a move, closing a grasp.

    A command equal to the one before it is ignored; a different one ends the motion under way.
    """

    def __init__(self, hand: Hand, lcm: Lcm, *, channels: LcmConfig, report: Callable[[str], None]) -> None:
        """Subscribes to the commands.

        Args:
            hand: what to drive.
            lcm: where commands come from and status goes; used by the thread that calls `run` alone.
            channels: names of the channels.
            report: called with one line for whoever looks after the robot.
        """
        self._hand, self._lcm, self._report = hand, lcm, report
        self._channel = channels.hand_status_channel
        self._inbox = Inbox(lcm, channels.hand_command_channel, lcmt_schunk_wsg_command, check=_check)
        self._num_reported = 0
        self._command: tuple[float, float] | None = None  # width [m], force [N]
        self._motion: threading.Thread | None = None
        self._last: HandState | None = None

    def run(self, stopping: Callable[[], bool]) -> None:
        """Connects, and drives until told to stop.

        Args:
            stopping: whether to stop.
        """
        connected, reported, due = False, False, time.monotonic()
        while not stopping():
            try:
                if not connected:
                    self._hand.connect()
                    if reported:
                        self._report("connected to the hand again")
                    connected, reported = True, False
                self.step()
                due = max(due + _PERIOD, time.monotonic())
                time.sleep(max(0.0, due - time.monotonic()))
            except ConnectionLost as error:
                connected, self._last = False, None
                if not reported:
                    reported = True
                    self._report(f"no connection to the hand ({error}); trying on, --hand none does without")
                end = time.monotonic() + _RECONNECT
                while not stopping() and time.monotonic() < end:
                    time.sleep(_PERIOD)
        self._end_motion()

    def step(self) -> None:
        """Takes in the newest command and publishes the state once."""
        self._lcm.HandleSubscriptions(0)
        if self._inbox.num_bad > self._num_reported:
            count = self._inbox.num_bad - self._num_reported
            self._num_reported += count
            self._report(f"dropped {count} hand command{'s' * (count > 1)}, the last one: {self._inbox.last_bad}")
        state = self._hand.read()
        if self._inbox.newest is not None:
            command = (1e-3 * self._inbox.newest.target_position_mm, self._inbox.newest.force)
            if command != self._command:
                self._command = command
                self._begin_motion(state.width, *command)
        self._publish(state)

    def _begin_motion(self, width: float, target: float, force: float) -> None:
        self._end_motion()

        def move() -> None:
            try:
                if target < width:
                    self._hand.grasp(target, _SPEED, force)
                else:
                    self._hand.move(target, _SPEED)
            except (MotionAborted, ConnectionLost) as error:
                self._report(f"the hand did not reach {1e3 * target:g} mm: {error}")

        # In a thread of its own: libfranka returns when the motion has ended, and status must go on.
        self._motion = threading.Thread(target=move, daemon=True)
        self._motion.start()

    def _end_motion(self) -> None:
        if self._motion is not None and self._motion.is_alive():
            try:
                self._hand.stop()
            except (MotionAborted, ConnectionLost) as error:
                self._report(f"the hand could not be stopped: {error}")
            self._motion.join(timeout=1.0)

    def _publish(self, state: HandState) -> None:
        message = lcmt_schunk_wsg_status()
        message.utime = round(1e6 * time.time())
        message.actual_position_mm = 1e3 * state.width
        message.actual_force = self._command[1] if state.grasped and self._command else 0.0
        if self._last is not None:
            message.actual_speed_mm_per_s = 1e3 * (state.width - self._last.width) / _PERIOD
        self._last = state
        self._lcm.Publish(self._channel, message.encode())


def _check(command: lcmt_schunk_wsg_command) -> str:
    width, force = 1e-3 * command.target_position_mm, command.force
    if not (math.isfinite(width) and 0.0 <= width <= _LARGEST_WIDTH + 1e-9):
        return f"width {1e3 * width:g} mm is outside 0 to {1e3 * _LARGEST_WIDTH:g} mm"
    if not (math.isfinite(force) and 0.0 <= force <= _LARGEST_FORCE):
        return f"force {force:g} N is outside 0 to {_LARGEST_FORCE:g} N"
    return ""
