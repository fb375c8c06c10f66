"""Session: the diagram on hardware, from the first status to the end of a collaboration."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.lcm.link import Lcm, LcmLink
from pace_drake.lcm.types import lcmt_pace_operator
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.safety.command_gate import GateMode
from pace_drake.safety.joint_limits import JOINT_LIMITS, NUM_JOINTS
from pace_drake.scenario import Scenario
from pace_drake.simulation import Listener, Simulation
from pace_drake.stations.hardware import HardwareStation, LcmLoop
from pace_drake.stations.motions import MotionLibrary, plan_motions
from pace_drake.stations.planning_scene import PlanningScene
from pace_drake.systems.operator_receiver import OperatorReceiver
from pace_drake.systems.tracked_person import TrackedPerson
from pace_drake.task import Episode

#: [s] between two reactions of the collaboration's logic.
REACTION_PERIOD = 0.01
#: [rad] between postures at which the straight way to the path is looked at.
_WAY_STEP = 0.02
#: [m] that the arm keeps on it.
_WAY_CLEARANCE = 0.005


@dataclass(frozen=True)
class Check:
    """One thing that must be right before the arm may move."""

    name: str
    good: bool
    found: str
    """What was found, and what to do if it is not good."""


class Session:
    """Leads the diagram on hardware: waits for the robot, checks, joins the path with the operator's leave, runs.

    ``step`` is called for ever, also while the operator thinks: only then the diagram sees the robot. The operator's
    leave (``press(ACKNOWLEDGE)``, or that message from anywhere) lets the arm move: first to where its motions begin,
    and, after trouble, back to its path. What happens is told line by line.

    Attributes:
        scenario, assembly, station, simulation, loop: what it leads.
        person: the TrackedPerson, None if the person is simulated.
        begun: whether the collaboration has begun.
        tell: called with each line.

    Args:
        scenario: a validated scenario; its ``lcm`` says where the robot is.
        policy: decides.
        lcm: the LCM of the robot.
        real_person: whether the hand comes from a tracker, over LCM; otherwise a person is simulated, and nobody is
            there.
        people: None loads those of the scenario.
        motions: None plans those of the scenario.
        clock: wall clock [s since the Unix epoch].
        steady: steady clock [s].
        tell: called with each line.
        poll_timeout: see ``LcmLoop``.

    Raises:
        InputError: the scenario cannot be used on hardware.
    """

    def __init__(
        self,
        scenario: Scenario,
        policy: Policy,
        lcm: Lcm,
        *,
        real_person: bool = False,
        people: People | None = None,
        motions: MotionLibrary | None = None,
        clock: Callable[[], float] = time.time,
        steady: Callable[[], float] = time.monotonic,
        tell: Callable[[str], None] = lambda line: None,
        poll_timeout: float = 0.01,
    ) -> None:
        config = scenario.lcm
        self.scenario, self._config, self._clock, self.tell = scenario, config, clock, tell
        if scenario.perception != "true_poses":
            raise InputError("perception: hardware has no cameras yet; components must lie at their nominal places")
        self._link = lcm if isinstance(lcm, LcmLink) else LcmLink(lcm)
        task = scenario.task
        motions = motions or plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions)
        self._home = motions.home
        self._scene = PlanningScene(scenario.workcell)
        self.station = HardwareStation(config, self._link, clock=clock, is_free=self.is_free)
        self.person: TrackedPerson | None = TrackedPerson(config, self._link) if real_person else None
        self.operator = self.person.operator if self.person else OperatorReceiver(self._link, config.operator_channel)
        self.assembly = Assembly(
            scenario,
            policy,
            station=self.station,
            motions=motions,
            people=people,
            person=self.person,
            operator=None if self.person else self.operator,
            lcm=self._link,
        )
        self.simulation = Simulation(self.assembly, period=REACTION_PERIOD)
        self._context = self.simulation.context
        self._start = self.assembly.GetInputPort("start")
        self._start.FixValue(self._context, 0.0)
        self.loop = LcmLoop(
            self.simulation.simulator,
            self._link,
            self.station,
            clock=steady,
            advance=lambda until: self.simulation.keep_up(until, self._begin_if_due),
            poll_timeout=poll_timeout,
        )
        self.begun = False
        self._due: Episode | None = None
        self._listeners: tuple[Listener, ...] = ()
        self._told: tuple[tuple[int, bool], str] = ((0, False), "")

    # ---- the course of a run

    def connect(self, timeout: float = 5.0) -> None:
        """Waits for the robot.

        Args:
            timeout: [s]

        Raises:
            InputError: no status came.
        """
        self.loop.initialize(timeout)

    def step(self) -> None:
        """Waits for messages, at most ``poll_timeout``, and advances to now."""
        self.loop.step()
        self._tell_changes()

    def begin(self, episode: Episode, listeners: tuple[Listener, ...] = ()) -> None:
        """Starts the collaboration as soon as the arm is where its motions begin.

        Args:
            episode: what was drawn of durations, and of the person if they are simulated.
            listeners: observers, such as an event log.
        """
        self._due, self._listeners = episode, listeners

    def _begin_if_due(self) -> None:
        if self._due is None or self.gate_mode != GateMode.FOLLOWING:
            return
        self.assembly.begin_episode(self._context, self._due)
        self._start.FixValue(self._context, 1.0)
        self.simulation.listeners = self._listeners
        self._due, self.begun = None, True

    def press(self, event: int) -> None:
        """Presses one of the operator's buttons, here and for whoever listens.

        Args:
            event: of ``lcmt_pace_operator``.
        """
        message = lcmt_pace_operator()
        message.utime, message.sender, message.event = round(1e6 * self._clock()), "pace bridge", event
        data = message.encode()
        self._link.Publish(self._config.operator_channel, data)
        self.operator.inbox.take(data)

    # ---- what it is like

    @property
    def time(self) -> float:
        """[s] of the diagram."""
        return self.simulation.time

    @property
    def finished(self) -> bool:
        """Whether the collaboration is over."""
        return self.begun and self.simulation.finished

    @property
    def gate_mode(self) -> GateMode:
        """What is sent."""
        return GateMode(int(self.simulation.output("gate_mode")[0]))

    @property
    def leaf(self) -> str:
        """The active state of the chart."""
        return self.assembly.task_statechart.compiled.chart.leaves[int(self.simulation.output("mode")[0])]

    @property
    def at_rest(self) -> bool:
        """Whether the arm is not asked to move."""
        sender = self.station.sender
        return not np.any(sender.state(sender.GetMyContextFromRoot(self._context)).velocity)

    @property
    def trouble(self) -> str:
        """One line that says what is wrong; empty if nothing is."""
        monitor = self.assembly.safety_monitor
        if line := self.station.describe_trouble(self._context):
            return line
        if monitor is not None and monitor.latched(monitor.GetMyContextFromRoot(self._context)):
            return f"the hand was not seen for {self.scenario.safety.hand_timeout:g} s: look after the tracker"
        return ""

    def is_free(self, start: np.ndarray, end: np.ndarray) -> bool:
        """Whether the arm may be led on a straight line from one position to another, each (7) [rad].

        An arm that already is near something, as when it holds a component, may go where nothing comes nearer.
        """
        count = int(np.ceil(np.max(np.abs(end - start)) / _WAY_STEP)) + 1
        least = min(_WAY_CLEARANCE, self._scene.clearance(start)[0], self._scene.clearance(end)[0]) - 1e-3
        shares = np.linspace(0.0, 1.0, count)[1:-1]
        return all(self._scene.clearance(start + share * (end - start))[0] >= least for share in shares)

    def checks(self) -> list[Check]:
        """What must be right before the arm may move; to be asked after a second of stepping."""
        config, output = self._config, self.simulation.output
        status = self.station.status
        status_context = status.GetMyContextFromRoot(self._context)
        measured = output("panda.position_measured")
        limits, names = JOINT_LIMITS[config.robot], [f"joint {k + 1}" for k in range(NUM_JOINTS)]
        beyond = np.maximum(
            limits.lower + config.limit_margin - measured, measured - limits.upper + config.limit_margin
        )
        way = np.abs(measured - self._home)
        skew = float(status.GetOutputPort("clock_skew").Eval(status_context)[0])
        age, mode = float(output("status_age")[0]), int(output("robot_mode")[0])
        others = self.station.watchdog.num_messages_of_others
        found = [
            Check("status", age <= config.status_timeout, f"{1e3 * age:.0f} ms old"),
            Check("robot mode", mode == 2, "Move" if mode == 2 else f"{mode}, not Move (2): release the robot"),
            Check("clocks", abs(skew) <= config.max_clock_skew, f"{1e3 * skew:+.0f} ms apart; synchronise them if far"),
            Check(
                "nobody else commands",
                not others,
                f"{others} messages of another program on {config.panda_command_channel}: stop it" if others else "yes",
            ),
            Check(
                "joint limits",
                bool(np.all(beyond < 0)),
                f"{names[int(np.argmax(beyond))]} is nearest, {-np.max(beyond) + config.limit_margin:.2f} rad away",
            ),
            Check(
                "way to the start",
                bool(np.max(way) <= config.join_range) and self.is_free(measured, self._home),
                f"{names[int(np.argmax(way))]} has {np.max(way):.2f} rad to go, at most {config.join_range:g}, "
                "and nothing may stand between",
            ),
        ]
        if self.person is not None:
            hand_age = float(
                self.person.GetOutputPort("hand_age").Eval(self.person.GetMyContextFromRoot(self._context))[0]
            )
            fresh = hand_age <= self.scenario.safety.hand_timeout
            found.append(
                Check(
                    "hand", fresh, f"{hand_age:.2f} s old" if np.isfinite(hand_age) else "no sample: start the tracker"
                )
            )
        return found

    # ---- telling

    def _tell_changes(self) -> None:
        trouble, leaf = self.trouble, self.leaf
        # The line itself may hold figures that change all the time.
        what = int(self.simulation.output("trouble")[0]), bool(trouble)
        if trouble and what != self._told[0]:
            self.tell(f"{'fault' if self.simulation.output('fault')[0] else 'stop'}: {trouble}")
        state = self._state(leaf, trouble)
        if state and state != self._told[1]:
            self.tell(state)
        self._told = what, state

    def _state(self, leaf: str, trouble: str) -> str:
        mode = self.gate_mode
        if trouble:
            return ""
        if mode == GateMode.JOINING:
            return "moving slowly to the path"
        if leaf in ("STOPPED", "FAULT") and mode == GateMode.FOLLOWING:
            return "on the path again: acknowledge to go on"
        if leaf in ("STOPPED", "FAULT"):
            return "stopped: acknowledge to lead the arm back to its path"
        if mode == GateMode.FOLLOWING:
            return "running" if self.begun else "at the start"
        return ""
