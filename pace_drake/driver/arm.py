"""ArmDriver: keeps a robot under control of the commands on LCM, through reflexes and lost connections."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from pace_drake.driver.commands import CommandReceiver
from pace_drake.driver.config import DriverConfig
from pace_drake.driver.limits import UsableLimits
from pace_drake.driver.robot import PERIOD, ConnectionLost, MotionAborted, Robot, RobotMode, RobotState
from pace_drake.driver.smoother import Smoother
from pace_drake.driver.status import Pace, make_status
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.link import Lcm

_LONGEST_DELAY = {"recover": 30.0, "connect": 8.0}  # [s]


class ArmDriver:
    """Moves the robot as commanded and publishes its state.

    It begins to control, and holds the position, as soon as the robot is idle. After a reflex it recovers, if it is
    to, and holds again; it never moves before a new command near the measured position. All the while it publishes,
    except while libfranka recovers and while the robot does not answer.

    Attributes:
        num_followed: how often the robot was not where it was sent, since commands were lost on their way.
    """

    def __init__(
        self,
        robot: Robot,
        lcm: Lcm,
        limits: UsableLimits,
        *,
        channels: LcmConfig,
        config: DriverConfig,
        report: Callable[[str], None],
        clock: Callable[[], float] = time.time,
        steady_clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """Subscribes to the commands.

        Args:
            robot: what to drive.
            lcm: where commands come from and status goes.
            limits: of the robot.
            channels: names of the channels.
            config: how to behave.
            report: called with one line for whoever looks after the robot.
            clock: wall clock [s] of the stamps.
            steady_clock: clock [s] of all delays and rates.
            sleep: waits [s].
        """
        self._robot, self._lcm, self._limits, self._config = robot, lcm, limits, config
        self._channel, self._report = channels.panda_status_channel, report
        self._clock, self._steady_clock, self._sleep = clock, steady_clock, sleep
        self._commands = CommandReceiver(
            lcm, channels.panda_command_channel, limits, config, clock=clock, steady_clock=steady_clock
        )
        self._status_pace, self._report_pace = Pace(config.status_rate), Pace(1.0)
        self._num_reported = 0
        self.num_followed = 0
        self._smoother: Smoother | None = None
        self._stopping: Callable[[], bool] = lambda: False

    def run(self, stopping: Callable[[], bool]) -> None:
        """Connects and drives until told to stop; then brakes within the limits and disconnects.

        Args:
            stopping: whether to stop.

        Raises:
            InputError: the robot can never be reached; see `Robot.connect`.
            ConnectionLost: the first connection failed. Later ones are tried again.
        """
        self._stopping = stopping
        self._robot.connect()
        self._report("connected to the robot; holding its position until a command comes")
        delay = 0.0
        while True:
            try:
                if delay:
                    self._robot.connect()
                    self._report("connected to the robot again")
                    delay = 0.0
                self._drive()
                break
            except ConnectionLost as error:
                delay = min(max(1.0, 2.0 * delay), _LONGEST_DELAY["connect"])
                self._commands.close("the robot does not answer")
                self._report(f"no connection to the robot ({error}); next attempt in {delay:g} s")
                self._robot.close()
            if self._wait(delay):
                break
        self._robot.close()

    def _drive(self) -> None:
        """Controls, and recovers, until told to stop."""
        delay, recover_at, control_at, mode = self._config.recover_delay, np.inf, -np.inf, None
        while not self._stopping():
            state = self._robot.read()
            self._look_round(state, controlled=False)
            if state.mode != mode:
                mode = state.mode
                if mode == RobotMode.REFLEX:
                    next_step = f"recovery in {delay:g} s" if self._config.recover else "waiting for its recovery"
                    recover_at = self._steady_clock() + delay
                    self._report(f"the robot is in reflex; {next_step}")
                elif mode != RobotMode.IDLE:
                    self._report(f"the robot is in mode {mode.name}; waiting until it is IDLE")
            if mode == RobotMode.IDLE and self._steady_clock() >= control_at:
                mode = None
                if self._control():
                    delay = self._config.recover_delay
                # A robot that is idle after all and aborts at once is not asked a thousand times a second.
                control_at = self._steady_clock() + self._config.recover_delay
            elif mode == RobotMode.REFLEX and self._config.recover and self._steady_clock() >= recover_at:
                mode, control_at = None, -np.inf
                delay = self._recover(delay)

    def _recover(self, delay: float) -> float:
        try:
            self._robot.recover()
        except MotionAborted as error:
            self._report(f"recovery failed: {error}")
            return min(2.0 * delay, _LONGEST_DELAY["recover"])
        self._report("recovered; holding the measured position until a new command comes")
        return delay

    def _control(self) -> bool:
        """Controls until told to stop, or the robot has aborted the motion; returns whether it began."""
        self._smoother = None
        try:
            self._robot.control(self._cycle)
        except MotionAborted as error:
            self._report(f"the motion was aborted: {error}")
        finally:
            self._commands.close("the robot is not under control")
        return self._smoother is not None

    def _cycle(self, state: RobotState, period: float) -> tuple[Sequence[float], bool]:
        if self._smoother is None:
            # What the robot holds at this moment; anything else would be a jump.
            self._smoother = Smoother(self._limits, np.array(state.q_d))
            self._commands.open()
        self._look_round(state, controlled=True)
        command = self._commands.take(np.array(state.q))
        if self._stopping():
            self._smoother.brake()
        elif command is not None:
            self._smoother.command(*command)
        self.num_followed += self._smoother.follow(np.array(state.q_d), np.array(state.dq_d), np.array(state.ddq_d))
        position = self._smoother.step(max(1, round(period / PERIOD)))
        return position.tolist(), self._stopping() and self._smoother.at_rest()

    def _look_round(self, state: RobotState, *, controlled: bool) -> None:
        """Takes in messages, publishes the status and reports dropped commands, each if due."""
        self._lcm.HandleSubscriptions(0)
        now = self._steady_clock()
        if self._status_pace.due(now):
            message = make_status(state, round(1e6 * self._clock()), controlled=controlled)
            self._lcm.Publish(self._channel, message.encode())
        dropped = self._commands.num_dropped - self._num_reported
        if dropped and self._report_pace.due(now):
            self._num_reported += dropped
            self._report(f"dropped {dropped} command{'s' * (dropped > 1)}, the last one: {self._commands.last_dropped}")

    def _wait(self, duration: float) -> bool:
        """Waits for a duration [s], or until told to stop; returns whether it was told to."""
        end = self._steady_clock() + duration
        while not self._stopping() and self._steady_clock() < end:
            self._lcm.HandleSubscriptions(0)
            self._sleep(0.02)
        return self._stopping()
