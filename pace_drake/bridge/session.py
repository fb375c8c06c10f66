"""Session: the diagram on hardware, from the first status to the end of a collaboration."""

import time
from collections.abc import Callable

import numpy as np

from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.lcm.link import Lcm, LcmLink
from pace_drake.lcm.types import lcmt_pace_operator
from pace_drake.people import People
from pace_drake.policies import Policy
from pace_drake.safety.command_gate import GateMode
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


class Session:
    """Leads the diagram on hardware: waits for the robot, checks, joins the path with the operator's leave, runs.

    ``step`` is called for ever, also while the operator thinks: only then the diagram sees the robot. The operator's
    leave (``press(ACKNOWLEDGE)``, or that message from anywhere) lets the arm move: first to where its motions begin,
    and, after trouble, back to its path. What happens is told line by line.

    Attributes:
        scenario, assembly, station, simulation, loop: what it leads.
        home: (7) [rad] where the motions begin.
        scene: what is in the arm's way.
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
        self.home, self.scene = motions.home, PlanningScene(scenario.workcell)
        self.station = HardwareStation(config, self._link, clock=clock, is_free=self.scene.is_free)
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
        self._told: tuple[tuple[int, bool, bool], str] = ((0, False, False), "")

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
        if line := self.assembly.describe_loss(self._context):
            return line
        if monitor is not None and monitor.latched(monitor.GetMyContextFromRoot(self._context)):
            return f"the hand was not seen for {self.scenario.safety.hand_timeout:g} s: look after the tracker"
        return ""

    # ---- telling

    def _tell_changes(self) -> None:
        trouble, leaf, lost = self.trouble, self.leaf, bool(self.assembly.describe_loss(self._context))
        # The line itself may hold figures that change all the time.
        what = int(self.simulation.output("trouble")[0]), bool(trouble), lost
        if trouble and what != self._told[0]:
            self.tell(f"{'fault' if lost or self.simulation.output('fault')[0] else 'stop'}: {trouble}")
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
