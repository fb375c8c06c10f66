"""The only wiring: human, estimator, policy, statechart, robot action, idle meter and a station, as one Diagram."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, InputPort, LeafSystem, System
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, VectorLogSink

from pace_drake.errors import InputError, require
from pace_drake.lcm.link import Lcm
from pace_drake.observation import OBSERVATION_SETS
from pace_drake.people import People, load_people
from pace_drake.policies import Policy, check_policy
from pace_drake.scenario import Scenario
from pace_drake.stations.components import component_index, components, nominal_poses
from pace_drake.stations.joint_paths import joint_paths
from pace_drake.stations.layout import Layout
from pace_drake.systems.action_monitor import ActionMonitor
from pace_drake.systems.decision import Decision
from pace_drake.systems.decision_publisher import DecisionPublisher
from pace_drake.systems.human import Human
from pace_drake.systems.idle_meter import IdleMeter
from pace_drake.systems.observation import Observation
from pace_drake.systems.observed_person import ObservedPerson
from pace_drake.systems.pace_monitor import PaceMonitor
from pace_drake.systems.phase_estimator import PhaseEstimator
from pace_drake.systems.robot_action import LetGo, Motions, RobotAction
from pace_drake.systems.state_publisher import StatePublisher
from pace_drake.systems.task_statechart import TaskStatechart
from pace_drake.task import ActionKind, Episode
from pace_drake.task_chart import make_task_chart

if TYPE_CHECKING:
    # What the plant level alone needs is imported where it is made: the task level starts without it.
    from pydrake.geometry import Meshcat

    from pace_drake.stations.plant import PlantStation
    from pace_drake.systems.component_locator import ComponentLocator
    from pace_drake.systems.grasp_monitor import GraspMonitor
    from pace_drake.systems.safety_monitor import SafetyMonitor

#: Operator inputs of the chart that the diagram exports; unconnected they have the chart's defaults.
OPERATOR_INPUTS = ("start", "stop", "fault", "ack")
#: Outputs of a station that may be logged; looking at every contact at every step costs an eighth of the plant's time.
JOINT_LOG = ("panda.position_measured", "panda.velocity_estimated", "gripper.state_measured")
FULL_LOG = (*JOINT_LOG, "contact")


class Assembly(Diagram):
    """The collaborative assembly.

    Exported inputs:
        assist (1): the decision; only without a policy.
        start, stop, fault, ack (1 each): the operator's; they may stay unconnected. With a hardware station they pass
            through its watchdog, which adds its own.
        stalled (1) [s]: only with a hardware station; time that the process has lost.
        button (1): how often the person has said "done"; only where an action monitor stands in for the truth; it may
            stay unconnected.
        hand_age (1) [s]: how old p_WH is; only with a safety monitor; it may stay unconnected.
        Of these, a real person's Diagram takes the place of those that it puts out.

    Exported outputs:
        mode, robot_task, joint_action, robot_action, decision_pending, finished (task_statechart);
        p_WH, human_action, human_elapsed, human_waiting (human: the truth; of a real person, what is observed); phase,
        phase_rate, remaining_time (phase_estimator); observation;
        robot_idle, human_idle, cost (idle_meter); those of the station; with cameras located_component_poses and
        located_component_ages (locator); with a safety monitor hand_distance, speed_scale, safety_stop (its ``stop``).

    Attributes:
        scenario: what it was built from.
        people: the demonstrations in it.
        human, phase_estimator, observation, task_statechart, robot_action, idle_meter: its systems. The human of a real
            person is an ObservedPerson, whose ``progress`` nobody knows.
        person: a real person's Diagram; None where a person is simulated.
        pace_monitor: the person's pace so far; None where the policy does not see it.
        action_monitor: what the robot knows of the person by observation; None where it is told.
        locator: finds the components with cameras; None where ``scenario.perception`` is not ``cameras``.
        safety_monitor: keeps the arm away from the hand; None without a station, or where the scenario switches it off.
        grasp_monitor: notices what the gripper has lost; None without a station that measures the gripper, or where
            the scenario switches it off.
        decision: the policy's system; None if the decision is an exported input.
        decision_publisher, state_publisher: publish the decisions and the state; None without ``lcm``.
        station: the plant or the hardware; None at the task level.
        plant_log: by the name of an output, Drake's VectorLogSink of it; empty if nothing is ``logged``.
        reaction_period: [s] or None; see below.
        reactive: the systems that update at an event, in the order in which they do, so that a command is taken at
            the very instant at which it was given.

    Args:
        scenario: a validated scenario.
        policy: answers the decisions, a subclass of ``Policy``; None exports the input ``assist`` for an adapter.
        station: a Diagram with the station ports (docs/design.md), or None for the task level.
        motions: planned motions; needed with a station.
        people: None loads those of the scenario; with a real person, ``load_people(scenario, tracked=True)``.
        logged: outputs of the station to be logged at every step of the plant (``plant_log``), such as ``JOINT_LOG``
            or ``FULL_LOG``; then the desired position is logged, too, and at every look of a safety monitor
            its hand_distance and speed_scale.
        reaction_period: None: events at exact times, advanced by ``pace_drake.simulation.Simulation``; a period [s]:
            the logic updates periodically, for any Simulator.
        person: a real person, such as a ``TrackedPerson``, or None for the simulated one. It puts out p_WH and may
            put out hand_age, button, stop and ack. The scenario's people are then those whom the estimators know. What
            is real foretells no event: ``Simulation.keep_up``, or a reaction period, lets it react at any time.
        operator: puts out stop and ack, and may put out button, such as an ``OperatorReceiver``; None: they come from
            the person, or from outside.
        lcm: where each decision and the state are published, on channels of ``scenario.lcm``; None: nowhere.

    Raises:
        InputError: the chart or the people of the scenario cannot be used, or the station has not the cameras that
            its perception needs, or the robot is to be told what a real person does, or a learned policy was trained
            with another phase estimate.
    """

    def __init__(
        self,
        scenario: Scenario,
        policy: Policy | None = None,
        *,
        station: Diagram | None = None,
        motions: Motions | None = None,
        people: People | None = None,
        logged: Sequence[str] = (),
        reaction_period: float | None = None,
        person: Diagram | LeafSystem | None = None,
        operator: LeafSystem | None = None,
        lcm: Lcm | None = None,
    ) -> None:
        super().__init__()
        if (station is None) != (motions is None):
            raise InputError("a station needs planned motions, and motions need a station")
        require(
            person is None or scenario.human.monitor != "told",
            "human.monitor",
            "a real person does not tell the robot what they do, must be detector or button, is 'told'",
        )
        if policy is not None:
            check_policy(policy)
        task = scenario.task
        self.scenario = scenario
        self.people = people or load_people(scenario, tracked=person is not None)
        require(
            person is None or not self.people.shift.any(),
            "human.workplace",
            "recordings were moved there, and a tracked hand is not: load_people(scenario, tracked=True), or set it to"
            " []",
        )
        task_chart = make_task_chart(scenario)
        chart = task_chart.compiled.chart
        builder = DiagramBuilder()

        def add(system):
            return builder.AddSystem(system)

        period = scenario.human.sample_period
        self.person = person
        self.human: Human | ObservedPerson
        if person is None:
            self.human = add(
                Human(
                    task,
                    self.people.demonstrations,
                    joint_paths(scenario.workcell, task.num_joint_actions),
                    period,
                    reaction_period,
                )
            )
        else:
            add(person)
            self.human = add(ObservedPerson(reaction_period))
        if operator is not None:
            add(operator)
        estimators = self.people.estimators(scenario)
        self.phase_estimator: PhaseEstimator = add(
            PhaseEstimator(estimators, period, periodic=reaction_period is not None)
        )
        if policy is not None:
            policy.check_estimates(scenario, self.people, estimators)
        seen = scenario.observation if policy is None else policy.observation
        self.observation: Observation = add(Observation(seen))
        self.pace_monitor: PaceMonitor | None = None
        if self.observation.HasInputPort("pace"):
            self.pace_monitor = add(PaceMonitor(task, reaction_period))
        self.task_statechart: TaskStatechart = add(TaskStatechart(*task_chart, reaction_period))
        self.safety_monitor: SafetyMonitor | None = None
        led = None
        if station is not None and scenario.safety.enabled:
            from pace_drake.stations.arm_capsules import load_arm_capsules
            from pace_drake.systems import safety_monitor

            self.safety_monitor = add(safety_monitor.SafetyMonitor(scenario.safety, load_arm_capsules()))
            led = safety_monitor.pacing(scenario.safety)
        self.grasp_monitor: GraspMonitor | None = None
        let_go = None
        measured = station is not None and station.HasOutputPort("gripper.state_measured")
        if measured and scenario.safety.grasp_check:
            from pace_drake.systems import grasp_monitor

            workcell, max_age = scenario.workcell, scenario.lcm.hand_status_timeout
            self.grasp_monitor = add(grasp_monitor.GraspMonitor(scenario.safety, workcell, max_age))
            let_go = LetGo(speed=workcell.gripper_speed, width=workcell.gripper_release)
        num_components = len(components(scenario.workcell))
        self.robot_action: RobotAction = add(
            RobotAction(task, motions, num_components, pacing=led, let_go=let_go, reaction_period=reaction_period)
        )
        self.idle_meter: IdleMeter = add(IdleMeter(task.num_joint_actions, task.human_idle_weight, reaction_period))
        self.action_monitor: ActionMonitor | None = None
        if scenario.human.monitor != "told":
            detectors = self.people.end_detectors(scenario, estimators)
            self.action_monitor = add(ActionMonitor(task, detectors, period, reaction_period))
        self.locator: ComponentLocator | None = None
        if station is not None and scenario.perception == "cameras":
            from pace_drake.systems.locator import make_component_locator

            self.locator = add(make_component_locator(scenario.workcell, reaction_period))
        self.decision: Decision | None = None
        self.station = station
        self.reaction_period = reaction_period
        self.decision_publisher: DecisionPublisher | None = None
        self.state_publisher: StatePublisher | None = None
        if lcm is not None:
            channels = scenario.lcm
            self.decision_publisher = add(
                DecisionPublisher(lcm, chart, OBSERVATION_SETS[seen], reaction_period, channels.decision_channel)
            )
            self.state_publisher = add(StatePublisher(lcm, chart.leaves, channels.state_channel))
        self.reactive: tuple[LeafSystem, ...] = (
            *(() if self.decision_publisher is None else (self.decision_publisher,)),
            self.task_statechart,
            *(() if self.locator is None else (self.locator,)),
            self.robot_action,
            self.human,
            *(system for system in (self.action_monitor, self.pace_monitor) if system is not None),
            self.idle_meter,
        )

        def connect(source: System, output: str, target: System, input: str) -> None:
            if target.HasInputPort(input):
                builder.Connect(source.GetOutputPort(output), target.GetInputPort(input))

        entered: set[str] = set()

        def enter(name: str, port: InputPort) -> None:
            # What a real person and the operator beside them say, or else what comes from outside.
            source = next((one for one in (person, operator) if one is not None and one.HasOutputPort(name)), None)
            if source is not None:
                builder.Connect(source.GetOutputPort(name), port)
            elif name in entered:
                builder.ConnectInput(name, port)
            else:
                builder.ExportInput(port, name)
                entered.add(name)

        # Where the hand is: the simulated person's, or tracked.
        hand: System = self.human if person is None else person
        # What the robot knows of the person: told, or observed.
        known: LeafSystem = self.human
        if self.action_monitor is not None:
            known = self.action_monitor
            connect(hand, "p_WH", self.action_monitor, "p_WH")
            connect(self.human, "joints_done", self.action_monitor, "joints_done")
            enter("button", self.action_monitor.GetInputPort("button"))
        # What the person does: the truth, or, of a real one, what is observed.
        true = self.human if person is None else known
        # The tracker's clock restarts with each true action; where that is not known the hand itself is sampled.
        connect(hand, "p_WH_sampled" if known is hand else "p_WH", self.phase_estimator, "p_WH")
        connect(known, "human_action", self.phase_estimator, "human_action")
        connect(self.task_statechart, "robot_task", self.observation, "robot_task")
        connect(known, "human_action", self.observation, "human_action")
        connect(known, "human_elapsed", self.observation, "human_elapsed")
        for name in ("phase", "phase_std", "remaining_time"):
            connect(self.phase_estimator, name, self.observation, name)
        if self.pace_monitor is not None:
            connect(known, "human_action", self.pace_monitor, "human_action")
            connect(known, "human_elapsed", self.pace_monitor, "human_elapsed")
            connect(self.pace_monitor, "pace", self.observation, "pace")
        connect(self.robot_action, "motion_done", self.task_statechart, "done")
        connect(self.robot_action, "robot_busy", self.task_statechart, "rb")
        connect(known, "human_joint", self.task_statechart, "hj")
        connect(self.human, "joints_done", self.task_statechart, "nj")
        connect(self.task_statechart, "robot_action", self.robot_action, "robot_action")
        connect(self.task_statechart, "joint_ready", self.human, "joint_ready")
        if person is not None:
            connect(self.task_statechart, "robot_action", self.human, "robot_action")
            connect(self.robot_action, "motion_done", self.human, "motion_done")
            connect(known, "human_joint", self.human, "human_joint")
        for name, source in (
            ("robot_waiting", self.task_statechart),
            ("human_waiting", self.human),
            ("human_joint", true),
        ):
            connect(source, name, self.idle_meter, name)
        if policy is not None:
            self.decision = add(Decision(policy))
            connect(self.observation, "observation", self.decision, "observation")
            connect(self.decision, "assist", self.task_statechart, "assist")
        else:
            builder.ExportInput(self.task_statechart.GetInputPort("assist"), "assist")
        sources = (self.task_statechart, known, self.human, self.phase_estimator, self.observation, self.decision)
        for publisher in (self.decision_publisher, self.state_publisher):
            if publisher is not None:
                for k in range(publisher.num_input_ports()):
                    shown = publisher.get_input_port(k)
                    name = shown.get_name()
                    teller = next((one for one in sources if one is not None and one.HasOutputPort(name)), None)
                    if teller is None:  # the answer from outside
                        builder.ConnectInput(name, shown)
                    else:
                        builder.Connect(teller.GetOutputPort(name), shown)
        if station is not None:
            builder.AddSystem(station)
        if self.safety_monitor is not None:
            connect(hand, "p_WH", self.safety_monitor, "p_WH")
            self._add_safety(builder, self.safety_monitor, connect, enter)
        self._add_operator(builder, enter)
        if self.grasp_monitor is not None and station is not None:
            connect(self.robot_action, "motion_progress", self.grasp_monitor, "motion_progress")
            connect(self.robot_action, "gripper_position", self.grasp_monitor, "gripper_position")
            connect(station, "gripper.state_measured", self.grasp_monitor, "gripper_state")
            if station.HasOutputPort("gripper.status_age"):
                connect(station, "gripper.status_age", self.grasp_monitor, "gripper_age")
            connect(self.grasp_monitor, "num_lost", self.robot_action, "num_lost")
        if station is not None:
            connect(self.robot_action, "position", station, "panda.position")
            connect(self.robot_action, "gripper_position", station, "gripper.position")
            connect(hand, "p_WH", station, "p_WH")
            connect(hand, "p_WH", self.robot_action, "p_WH")
            connect(station, "panda.position_measured", self.robot_action, "position_measured")
            self._locate_components(builder, station, scenario)
            if self.safety_monitor is not None:
                connect(station, "panda.position_measured", self.safety_monitor, "position_measured")
            for k in range(station.num_output_ports()):
                builder.ExportOutput(station.get_output_port(k), station.get_output_port(k).get_name())
        self.plant_log: dict[str, VectorLogSink] = {}
        if logged and station is not None:
            logs = {name: station.GetOutputPort(name) for name in logged}
            logs["position_desired"] = self.robot_action.GetOutputPort("position")
            for name, port in logs.items():
                self.plant_log[name] = LogVectorOutput(port, builder, scenario.workcell.time_step)
            if self.safety_monitor is not None:
                for name in ("hand_distance", "speed_scale"):
                    port = self.safety_monitor.GetOutputPort(name)
                    self.plant_log[name] = LogVectorOutput(port, builder, scenario.safety.period)
        for source, names in (
            (
                self.task_statechart,
                ("mode", "robot_task", "joint_action", "robot_action", "decision_pending", "finished"),
            ),
            (hand, ("p_WH",)),
            (true, ("human_action", "human_elapsed")),
            (self.human, ("human_waiting",)),
            (self.phase_estimator, ("phase", "phase_rate", "remaining_time")),
            (self.observation, ("observation",)),
            (self.idle_meter, ("robot_idle", "human_idle", "cost")),
        ):
            for name in names:
                builder.ExportOutput(source.GetOutputPort(name), name)
        builder.BuildInto(self)
        self.set_name("assembly")

    def _locate_components(self, builder: DiagramBuilder, station: Diagram, scenario: Scenario) -> None:
        """Where the components are: as the cameras see them, or true where the station knows, or nominal."""
        inputs = [self.robot_action.GetInputPort(name) for name in ("component_poses", "component_ages")]
        if self.locator is not None:
            commanded = (
                self.task_statechart.GetOutputPort("robot_action")
                if self.grasp_monitor is None
                else self.robot_action.GetOutputPort("to_locate")
            )
            builder.Connect(commanded, self.locator.GetInputPort("robot_action"))
            for k in range(self.locator.num_input_ports()):
                port = self.locator.get_input_port(k)
                if port.get_name() == "robot_action":
                    continue
                if not station.HasOutputPort(port.get_name()):
                    raise InputError(
                        f"perception: cameras needs a station with {port.get_name()}; make one with cameras"
                    )
                builder.Connect(station.GetOutputPort(port.get_name()), port)
            for port in inputs:
                located = self.locator.GetOutputPort(port.get_name())
                builder.Connect(located, port)
                builder.ExportOutput(located, f"located_{port.get_name()}")
            return
        if station.HasOutputPort("component_poses"):
            builder.Connect(station.GetOutputPort("component_poses"), inputs[0])
        else:
            source = ConstantVectorSource(nominal_poses(scenario.workcell))
            builder.Connect(builder.AddNamedSystem("component_poses", source).get_output_port(), inputs[0])
        ages = builder.AddNamedSystem(
            "component_ages", ConstantVectorSource(np.zeros(len(components(scenario.workcell))))
        )
        builder.Connect(ages.get_output_port(), inputs[1])

    def _plant_station(self) -> "PlantStation | None":
        """The station if components lie about in it."""
        if self.station is None or not self.station.HasOutputPort("component_poses"):
            return None
        return cast("PlantStation", self.station)

    def set_layout(self, context: Context, layout: Layout) -> None:
        """Puts the components where an episode begins; only with a plant."""
        plant = self._plant_station()
        assert plant is not None
        plant.set_layout(context, layout)

    def describe_loss(self, context: Context) -> str:
        """One line that says what the gripper has lost, until that is acknowledged; empty where nothing is."""
        monitor = self.grasp_monitor
        return "" if monitor is None else monitor.describe(monitor.GetMyContextFromRoot(context))

    def refill_pile(self, context: Context) -> None:
        """Puts the cube that an update of ``robot_action`` now would fetch back into the pile, if it is not there."""
        plant = self._plant_station()
        if plant is None:
            return
        begins = self.robot_action.begins(self.robot_action.GetMyContextFromRoot(context))
        if begins is not None and begins[0] == ActionKind.ROBOT_TASK:
            kind, index, sequence = begins
            cube = component_index(self.scenario.workcell, kind, index)
            assert cube is not None
            plant.refill(context, cube, sequence)

    def _add_operator(self, builder: DiagramBuilder, enter: Callable[[str, InputPort], None]) -> None:
        """Lets the operator's signals in: stop and fault pass through whatever adds its own, the others go to all."""
        systems = (self.station, self.safety_monitor, self.grasp_monitor, self.task_statechart)
        for name in OPERATOR_INPUTS:
            first, *others = [system for system in systems if system is not None and system.HasInputPort(name)] or [
                None
            ]
            if first is None:
                continue
            enter(name, first.GetInputPort(name))
            for system in others:
                if first.HasOutputPort(name):
                    builder.Connect(first.GetOutputPort(name), system.GetInputPort(name))
                    first = system
                else:
                    enter(name, system.GetInputPort(name))
        if self.station is not None and self.station.HasInputPort("stalled"):
            builder.ExportInput(self.station.GetInputPort("stalled"), "stalled")

    def _add_safety(
        self,
        builder: DiagramBuilder,
        monitor: "SafetyMonitor",
        connect: Callable[[System, str, System, str], None],
        enter: Callable[[str, InputPort], None],
    ) -> None:
        """Wires the safety monitor."""
        for name in ("path_position", "path_velocity", "motion_progress"):
            connect(self.robot_action, name, monitor, name)
        connect(monitor, "speed_scale", self.robot_action, "speed_scale")
        enter("hand_age", monitor.GetInputPort("hand_age"))
        for source, target in (("hand_distance",) * 2, ("speed_scale",) * 2, ("stop", "safety_stop")):
            builder.ExportOutput(monitor.GetOutputPort(source), target)

    def set_episode(self, context: Context, episode: Episode) -> None:
        """Puts everything random of one episode into the diagram's context."""
        self.human.set_episode(self.human.GetMyMutableContextFromRoot(context), episode)
        self.robot_action.set_episode(self.robot_action.GetMyMutableContextFromRoot(context), episode)

    def begin_episode(self, context: Context, episode: Episode) -> None:
        """Starts an episode at the context's time, where the robot and those who watch it have long been at work."""
        for system in (
            self.phase_estimator,
            self.pace_monitor,
            self.action_monitor,
            self.idle_meter,
            self.grasp_monitor,
        ):
            if system is not None:
                system.SetDefaultContext(system.GetMyMutableContextFromRoot(context))
        if self.action_monitor is not None:
            self.action_monitor.begin(self.action_monitor.GetMyMutableContextFromRoot(context))
        self.set_episode(context, episode)


def make_plant_assembly(
    scenario: Scenario,
    policy: Policy | None = None,
    *,
    meshcat: "Meshcat | None" = None,
    people: People | None = None,
    logged: Sequence[str] = (),
) -> Assembly:
    """Makes the assembly of the plant level: motions planned, cameras where the scenario's perception wants them.

    Args:
        scenario, policy, people, logged: see ``Assembly``.
        meshcat: shows the plant if given.

    Raises:
        InputError: a motion cannot be planned, this machine cannot render for cameras, or as ``Assembly``.
    """
    from pace_drake.stations.motions import plan_motions
    from pace_drake.stations.plant import make_plant_station

    task, workcell = scenario.task, scenario.workcell
    motions = plan_motions(workcell, task.num_robot_tasks, task.num_joint_actions)
    station = make_plant_station(workcell, meshcat=meshcat, cameras=scenario.perception == "cameras")
    return Assembly(scenario, policy, station=station, motions=motions, people=people, logged=logged)
