"""The hardware station: the same ports as the plant's, on LCM, with watchdogs; and the loop that keeps its time."""

import math
import time
from collections.abc import Callable

import numpy as np
from drake import lcmt_panda_command
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPort
from pydrake.systems.primitives import PassThrough

from pace_drake.errors import InputError
from pace_drake.lcm.command_sender import GripperCommandSender, PandaCommandSender
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.inbox import Inbox
from pace_drake.lcm.link import Lcm, LcmLink
from pace_drake.lcm.status_receiver import GripperStatusReceiver, PandaStatusReceiver
from pace_drake.lcm.watchdog import Watchdog
from pace_drake.safety.command_gate import CommandGate
from pace_drake.safety.joint_limits import JOINT_LIMITS


class HardwareStation(Diagram):
    """Drives a Franka Panda (FER) or FR3 through the LCM contract of the TRI driver.

    Nothing is sent before the operator's first ``ack``. That, and every one after a fault, leads the arm slowly from
    where it is measured to the commanded position, and only then follows it; until then ``stop`` is 1.
    This is a research aid, not a safety function: e-stop, the robot's own safety functions and a risk assessment remain
    required (docs/hardware.md).

    Inputs:
        panda.position (7) [rad]: commanded joint position.
        gripper.position (1) [m]: commanded width between the fingers.
        p_WH (3) [m]: the person's hand; taken for the sake of equal ports, the person is real here.
        stop, fault, ack (1 each): the operator's; they may stay unconnected.
        stalled (1) [s]: time that this process has lost (``LcmLoop``); it may stay unconnected.

    Outputs:
        panda.position_measured (7) [rad], panda.velocity_estimated (7) [rad/s].
        panda.torque_external (7) [Nm]: in Drake's sign, the opposite of the message's.
        gripper.state_measured (2) [m, m/s]: width and its rate (the TRI driver reports 0.005 m/s whenever the gripper
            moves).
        gripper.status_age (1) [s]: time since the last gripper status; infinite before the first.
        robot_mode (1): libfranka's robot mode; 2 = Move.
        status_age (1) [s]: time since the last arm status; infinite before the first.
        num_status (1): arm status messages so far.
        gate_mode (1): see ``pace_drake.safety.command_gate.GateMode``.
        stop, fault, trouble (1 each): see ``Watchdog``.

    Attributes:
        command_period: [s] between two commands.
        status: its PandaStatusReceiver.
        sender: its PandaCommandSender.
        watchdog: its Watchdog.

    Args:
        config: channels, rates and limits.
        lcm: an LCM, from ``pace_drake.lcm.url.open_lcm``; an LcmLink is used as it is, anything else through one.
        clock: wall clock [s since the Unix epoch] that stamps the commands.
        is_free: whether the straight way between two joint positions (7) [rad] is free of obstacles.

    Raises:
        InputError: `config` cannot be used.
    """

    def __init__(
        self,
        config: LcmConfig,
        lcm: Lcm,
        *,
        clock: Callable[[], float] = time.time,
        is_free: Callable[[np.ndarray, np.ndarray], bool] = lambda start, end: True,
    ) -> None:
        super().__init__()
        config.validate()
        self.command_period = 1.0 / config.command_rate
        link = lcm if isinstance(lcm, LcmLink) else LcmLink(lcm)
        builder = DiagramBuilder()
        gate = CommandGate(
            limits=JOINT_LIMITS[config.robot],
            period=self.command_period,
            margin=config.limit_margin,
            tolerance=config.start_tolerance,
            join_speed=config.join_speed,
            join_range=config.join_range,
            is_free=is_free,
        )
        self.status: PandaStatusReceiver = builder.AddNamedSystem(
            "panda.status", PandaStatusReceiver(link, config.panda_status_channel, clock)
        )
        self.sender: PandaCommandSender = builder.AddNamedSystem(
            "panda.command",
            PandaCommandSender(
                link,
                gate,
                channel=config.panda_command_channel,
                status_timeout=config.status_timeout,
                max_stall=config.max_stall,
                clock=clock,
            ),
        )
        self.watchdog: Watchdog = builder.AddNamedSystem(
            "watchdog", Watchdog(config, Inbox(link, config.panda_command_channel, lcmt_panda_command))
        )
        for source in (self.status, self.sender):
            for k in range(source.num_output_ports()):
                port = source.get_output_port(k)
                for target in (self.sender, self.watchdog):
                    if target is not source and target.HasInputPort(port.get_name()):
                        builder.Connect(port, target.GetInputPort(port.get_name()))
        builder.Connect(self.watchdog.GetOutputPort("fault"), self.sender.GetInputPort("fault"))

        gripper = builder.AddNamedSystem("gripper.status", GripperStatusReceiver(link, config.hand_status_channel))
        gripper_sender = builder.AddNamedSystem(
            "gripper.command",
            GripperCommandSender(
                link,
                channel=config.hand_command_channel,
                rate=config.hand_command_rate,
                status_timeout=config.hand_status_timeout,
                force=config.gripper_force,
                clock=clock,
            ),
        )
        builder.Connect(gripper.GetOutputPort("status_age"), gripper_sender.GetInputPort("status_age"))
        builder.Connect(self.sender.GetOutputPort("following"), gripper_sender.GetInputPort("following"))
        hand = builder.AddNamedSystem("p_WH", PassThrough(3))

        builder.ExportInput(self.sender.GetInputPort("position"), "panda.position")
        builder.ExportInput(gripper_sender.GetInputPort("position"), "gripper.position")
        builder.ExportInput(hand.get_input_port(), "p_WH")
        builder.ExportInput(self.sender.GetInputPort("enable"), "ack")
        builder.ConnectInput("ack", self.watchdog.GetInputPort("ack"))
        builder.ExportInput(self.sender.GetInputPort("stalled"), "stalled")
        for name in ("stop", "fault"):
            builder.ExportInput(self.watchdog.GetInputPort(name), name)
        for system, output, name in (
            (self.status, "position_measured", "panda.position_measured"),
            (self.status, "velocity_measured", "panda.velocity_estimated"),
            (self.status, "torque_external", "panda.torque_external"),
            (gripper, "state", "gripper.state_measured"),
            (gripper, "status_age", "gripper.status_age"),
            *((self.status, name, name) for name in ("robot_mode", "status_age", "num_status")),
            (self.sender, "gate_mode", "gate_mode"),
            *((self.watchdog, name, name) for name in ("stop", "fault", "trouble")),
        ):
            builder.ExportOutput(system.GetOutputPort(output), name)
        builder.BuildInto(self)
        self.set_name("station")

    def describe_trouble(self, context: Context) -> str:
        """One line that says what is wrong and what to do; empty if nothing is.

        Args:
            context: of the diagram that holds the station.
        """
        return self.watchdog.describe(self.watchdog.GetMyContextFromRoot(context), self.status.inbox)


#: How much of its distance from the middle between two ticks a status shifts the loop's clock.
_LOCK_GAIN = 0.02
#: [s] beyond a tick, so that its updates are done in the advance that leads there and not in the next.
_PAST_TICK = 1e-6


class LcmLoop:
    """Advances a simulator in lock-step with the driver: every status finds its command tick.

    Context time is the time of ``clock`` since ``initialize``, on top of the context's initial time. It is not the
    status's ``utime``: that stops when the robot stops talking, which is when watchdogs must run on, and the clock of
    the driver's machine may step. It advances from one command tick to the next, and what comes from the driver is
    taken in before: at the nearest tick, to which the clock is slowly shifted, so that as many come before as after.
    So a command is sent a moment after the status on which it builds, and not up to a period later.

    Time that this process loses (it was not scheduled, or something took long) is left out: the paths wait for the
    process, since to catch up would be to command more than was planned. What was left out is told to the diagram's
    input ``stalled``, where the station's watchdog looks at it.

    Do not set the simulator's target realtime rate: the messages keep the time.

    Attributes:
        stalled: [s] left out so far.
    """

    def __init__(
        self,
        simulator: Simulator,
        lcm: Lcm,
        station: HardwareStation,
        *,
        clock: Callable[[], float] = time.monotonic,
        advance: Callable[[float], object] | None = None,
        poll_timeout: float = 0.01,
        max_advance: float = 0.02,
    ) -> None:
        """Sends and receives nothing yet.

        Args:
            simulator: of a diagram that holds the station.
            lcm: the LCM of the station.
            station: whose status sets the pace.
            clock: steady clock [s] that gives the context time.
            advance: advances the simulator to a time [s]; None: its AdvanceTo.
            poll_timeout: how long `step` waits for a message [s, whole ms]; 0 where a peer in this process is called
                in between, since on ``memq://`` nothing can arrive during the wait.
            max_advance: how much time may pass between two steps [s] without any being left out; more than
                `poll_timeout`.
        """
        self._simulator, self._lcm, self._clock = simulator, lcm, clock
        self._status, self._period = station.status.inbox, station.command_period
        self._advance = advance or simulator.AdvanceTo
        self._poll_milliseconds = round(1e3 * poll_timeout)
        self._max_advance = max_advance
        self._time_offset = math.nan  # [s] context time minus clock time
        self.stalled = 0.0
        diagram = simulator.get_system()
        self._stalled_port: InputPort | None = (
            diagram.GetInputPort("stalled") if diagram.HasInputPort("stalled") else None
        )

    def initialize(self, timeout: float = 5.0) -> None:
        """Waits for the first status, then initializes the simulator, so that no zeros are taken for a pose.

        Args:
            timeout: how long to wait [s].

        Raises:
            InputError: no status came.
        """
        deadline = self._clock() + timeout
        while True:
            self._lcm.HandleSubscriptions(self._poll_milliseconds)
            if self._status.num_good:
                break
            if self._clock() >= deadline:
                raise InputError(
                    f"no usable {self._status.channel} message within {timeout:g} s: start the robot's driver, or "
                    "correct lcm.url or the channel"
                )
        self._simulator.Initialize()
        self._time_offset = self._simulator.get_context().get_time() - self._clock()

    def step(self) -> int:
        """Waits for messages (at most `poll_timeout`), takes them in and advances the diagram to now.

        It advances without messages as well, so that the diagram sees that the robot has fallen silent.

        Returns:
            The number of good status messages that came.

        Raises:
            RuntimeError: `initialize` has not been called.
        """
        if math.isnan(self._time_offset):
            raise RuntimeError("LcmLoop.step needs LcmLoop.initialize first")
        num_status = self._status.num_good
        self._lcm.HandleSubscriptions(self._poll_milliseconds)
        num_status = self._status.num_good - num_status
        context = self._simulator.get_mutable_context()
        now = self._clock() + self._time_offset
        late = now - context.get_time() - self._max_advance
        if late > 0:
            self._time_offset -= late
            self.stalled += late
            if self._stalled_port is not None:
                self._stalled_port.FixValue(context, self.stalled)
            now -= late
        # A tick waits half a period for its status: other messages, and one's own that come back, end the wait, too.
        tick = math.floor(now / self._period + (0.5 if num_status else -0.5)) * self._period
        if num_status:
            self._time_offset -= _LOCK_GAIN * (now - tick)
        # A clock that steps back (it should not) stops the diagram for a while; it cannot run backwards.
        if tick + _PAST_TICK > context.get_time():
            self._advance(tick + _PAST_TICK)
        return num_status
