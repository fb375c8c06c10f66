"""A whole collaboration with a person who is not in the diagram: hand and buttons by LCM, decisions out of it.

The person is scripted, by a ``Human`` of its own that sees nothing but whether the robot is ready.
"""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, PassThrough

from pace_drake.demos import generate_demonstrations, read_demonstrations, write_demonstrations
from pace_drake.demos.signals import folder_signals
from pace_drake.diagram import Assembly
from pace_drake.dtw.estimator_file import write_estimator_file
from pace_drake.dtw.tune import Setting, Tuned
from pace_drake.errors import InputError
from pace_drake.evaluate.tuning import estimator_file
from pace_drake.lcm.types import lcmt_pace_decision, lcmt_pace_operator, lcmt_pace_state
from pace_drake.people import load_people
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.systems.human import Human
from pace_drake.systems.observed_person import ObservedPerson
from pace_drake.systems.tracked_person import TrackedPerson
from pace_drake.task import ActionKind
from tests.lcm.senders import hand, press
from tests.short_scenario import short_scenario
from tests.systems.forced import force_update

PERIOD = 0.01  # [s]
REQUEST, STOP, ACKNOWLEDGE = lcmt_pace_operator.REQUEST, lcmt_pace_operator.STOP, lcmt_pace_operator.ACKNOWLEDGE


class Collaboration:
    """An assembly with a tracked person, and the person."""

    def __init__(self, policy, *overrides, **kwargs):
        self.scenario = short_scenario("human.monitor=button", *overrides)
        self.lcm = DrakeLcm("memq://")
        self.assembly = Assembly(
            self.scenario,
            None if policy is None else make_policy(policy, self.scenario),
            reaction_period=PERIOD,
            person=TrackedPerson(self.scenario.lcm, self.lcm),
            lcm=self.lcm,
            **kwargs,
        )
        self.published = []
        self.lcm.Subscribe("PACE_DECISION", lambda data: self.published.append(lcmt_pace_decision.decode(data)))
        self.states = []
        self.lcm.Subscribe("PACE_STATE", lambda data: self.states.append(lcmt_pace_state.decode(data)))
        self.simulator = Simulator(self.assembly)
        self.context = self.simulator.get_mutable_context()
        episode = self.assembly.people.sample(self.scenario, np.random.default_rng(1))
        self.assembly.set_episode(self.context, episode)
        self.human = Human(self.scenario.task, self.assembly.people.demonstrations)
        self.human_context = self.human.CreateDefaultContext()
        self.human.set_episode(self.human_context, episode)
        self.human.GetInputPort("joint_ready").FixValue(self.human_context, 0.0)
        self.step_number = self.num_presses = 0
        self.action = 1
        self.decisions = []
        self.commands = []

    @property
    def time(self):
        return self.context.get_time()

    def output(self, name):
        return self.assembly.GetOutputPort(name).Eval(self.context)

    def of_chart(self, name):
        chart = self.assembly.task_statechart
        return chart.GetOutputPort(name).Eval(chart.GetMyContextFromRoot(self.context))[0]

    def of_human(self, name):
        return self.human.GetOutputPort(name).Eval(self.human_context)

    def press(self, event):
        self.num_presses += 1
        self.lcm.Publish("PACE_OPERATOR", press(event, self.num_presses))

    def live(self):
        """What the person does at this instant: moves the hand, and says when an action of their own is over."""
        self.human_context.SetTime(self.time)
        self.human.GetInputPort("joint_ready").FixValue(self.human_context, self.of_chart("joint_ready"))
        force_update(self.human, self.human_context)
        action = int(self.of_human("human_action")[0])
        if action > self.action and self.action not in self.scenario.task.human_index_of_joint:
            self.press(REQUEST)
        self.action = action
        self.lcm.Publish("PACE_HAND", hand(self.step_number, self.of_human("p_WH")))
        self.lcm.HandleSubscriptions(0)

    def step(self):
        """One period: the updates of this instant, of which it notes the decisions that they make."""
        self.live()
        seen = self.output("observation").tolist(), self.output("phase")[0]
        time = self.time
        self.step_number += 1
        self.simulator.AdvanceTo(self.step_number * PERIOD)
        chart = self.assembly.task_statechart
        for reaction in chart.reactions(chart.GetMyContextFromRoot(self.context)):
            answer = {"d_no": 0, "d_yes": 1, "d_timeout": -1}.get(reaction.transition)
            if answer is not None:
                index, joint = int(self.of_chart("decision_index")), int(self.output("joint_action")[0])
                self.decisions.append((time, index, answer, joint, reaction.transition, reaction.target, *seen))
        command = self.output("robot_action").astype(int).tolist()
        if not self.commands or command != self.commands[-1]:
            self.commands.append(command)

    def run(self, until=lambda: False, limit=100.0):
        while not self.output("finished")[0] and not until():
            assert self.time < limit
            self.step()

    def joints_done(self):
        return int(self.assembly.human.GetOutputPort("joints_done").Eval(self.human_of_diagram())[0])

    def human_of_diagram(self):
        return self.assembly.human.GetMyContextFromRoot(self.context)


def told(message):
    observation = list(message.observation)
    assert (message.robot_task, message.human_action, message.elapsed) == tuple(observation[:3])
    return (
        *(message.time, message.decision_index, message.assist, message.joint_action),
        *(message.transition, message.leaf, observation, message.phase),
    )


def test_a_collaboration_comes_to_its_end_and_its_decisions_are_published():
    dut = Collaboration("phase_threshold")
    dut.run()
    dut.lcm.HandleSubscriptions(0)
    assert dut.of_human("joints_done")[0] >= 2  # the last one may end with the robot's homing
    assert dut.joints_done() == 3
    assert dut.output("human_action")[0] == 6
    joints = [index for kind, index, _ in dut.commands if kind == ActionKind.JOINT]
    assert joints == [1, 2, 3]
    assert [told(message) for message in dut.published] == dut.decisions
    assert {message.assist for message in dut.published} == {0, 1}
    assert [m.decision_index for m in dut.published] == list(range(1, len(dut.decisions) + 1))
    assert dut.assembly.person.hand.inbox.num_good == dut.step_number
    # All that the person did by themselves was over when they said so, and they waited as the meter says.
    assert (dut.output("human_idle") >= 0).all()
    assert dut.output("human_idle").sum() + dut.output("robot_idle").sum() > 0


def test_the_state_is_published():
    dut = Collaboration("phase_threshold")
    dut.run()
    dut.lcm.HandleSubscriptions(0)
    np.testing.assert_allclose([state.time for state in dut.states], 0.05 * np.arange(len(dut.states)), atol=1e-9)
    assert dut.time - dut.states[-1].time <= 0.05 + 1e-9
    leaves = {state.leaf for state in dut.states}
    assert leaves - {"WAIT"} == {"READY", "ROBOT_TASK", "PREP", "JOINT", "HOMING", "DONE"}
    assert {state.human_action for state in dut.states} == set(range(1, 7))
    assert all((state.joint_ready > 0) == (state.leaf == "JOINT") for state in dut.states)
    assert all((state.robot_waiting > 0) == (state.leaf == "WAIT") for state in dut.states)
    assert {state.joint_ready for state in dut.states} == {0, 1, 2, 3}
    # Nobody waits for a robot that is there.
    assert not any(state.human_waiting and state.joint_ready for state in dut.states)
    assert any(state.human_waiting for state in dut.states)
    assert all(state.phase == 1.0 for state in dut.states if state.joint_ready)


def test_a_decision_may_be_answered_from_outside():
    dut = Collaboration(None, "decision_timeout=0.5")
    answer = dut.assembly.GetInputPort("assist")
    answer.FixValue(dut.context, -1.0)
    dut.run(until=lambda: dut.time > 0.2)
    answer.FixValue(dut.context, 1.0)
    dut.run(until=lambda: len(dut.decisions) == 1)
    dut.step()
    dut.lcm.HandleSubscriptions(0)
    assert [told(message) for message in dut.published] == dut.decisions
    assert [(message.assist, message.leaf) for message in dut.published] == [(1, "PREP")]


def test_a_stop_while_a_decision_is_asked_for_is_no_decision():
    dut = Collaboration(None, "decision_timeout=10.0")
    answer = dut.assembly.GetInputPort("assist")
    answer.FixValue(dut.context, -1.0)
    dut.run(until=lambda: dut.time > 0.2)
    dut.press(STOP)
    dut.run(until=lambda: dut.time > 0.5)
    assert dut.output("robot_action")[0] == ActionKind.HOLD
    dut.press(ACKNOWLEDGE)
    dut.run(until=lambda: dut.time > 1.5)
    answer.FixValue(dut.context, 0.0)
    dut.run(until=lambda: dut.time > 2.0)
    dut.lcm.HandleSubscriptions(0)
    assert [message.transition for message in dut.published] == ["d_no"]


def test_the_person_is_known_as_by_a_simulation_of_them():
    # Both people and robots draw the same; the real person's robot learns of them by button and hand alone.
    dut = Collaboration("always")
    dut.run()
    simulated = Assembly(
        short_scenario(), make_policy("always", dut.scenario), people=dut.assembly.people, reaction_period=PERIOD
    )
    simulator = Simulator(simulated)
    context = simulator.get_mutable_context()
    simulated.set_episode(context, simulated.people.sample(dut.scenario, np.random.default_rng(1)))
    while not simulated.GetOutputPort("finished").Eval(context)[0]:
        simulator.AdvanceTo(context.get_time() + PERIOD)
    for name in ("robot_idle", "human_idle"):
        # Each joint action is noticed by up to a sample of the monitor later, at both of its ends.
        np.testing.assert_allclose(dut.output(name), simulated.GetOutputPort(name).Eval(context), atol=0.3)
    assert dut.time == pytest.approx(context.get_time(), abs=1.0)


@pytest.mark.parametrize("kind", [ActionKind.JOINT, ActionKind.PREPARE, ActionKind.HOME, ActionKind.ROBOT_TASK])
def test_a_stop_in_anything_is_gone_on_from(kind):
    dut = Collaboration("phase_threshold")
    dut.run(until=lambda: dut.output("robot_action")[0] == kind)
    index, number = dut.output("robot_action")[1:]
    begun = dut.time
    dut.run(until=lambda: dut.time > begun + 0.2)
    dut.press(STOP)
    dut.step()
    dut.step()
    assert dut.output("robot_action")[0] == ActionKind.HOLD
    before = dut.time
    dut.run(until=lambda: dut.time > before + 1.0)
    assert dut.output("robot_action")[0] == ActionKind.HOLD
    dut.press(ACKNOWLEDGE)
    dut.run(until=lambda: dut.output("robot_action")[0] != ActionKind.HOLD, limit=before + 2.0)
    assert dut.output("robot_action")[1] == index
    assert dut.output("robot_action")[2] == number + 1  # issued again
    dut.run()
    assert dut.joints_done() == 3


def test_a_decision_without_an_answer_is_published_once():
    dut = Collaboration("phase_threshold", "decision_timeout=0.05")
    dut.assembly.decision._policy = Silent(dut.assembly.decision._policy)
    dut.run(until=lambda: len(dut.decisions) == 3)
    dut.step()
    dut.lcm.HandleSubscriptions(0)
    assert [told(message) for message in dut.published] == dut.decisions
    assert [message.assist for message in dut.published] == [-1, -1, -1]
    assert [message.transition for message in dut.published] == ["d_timeout"] * 3


class Silent:
    """Has no answer."""

    def __init__(self, policy):
        self.observation = policy.observation

    def decide(self, observation):
        return -1


def test_before_the_first_sample_the_hand_is_nowhere_and_nothing_breaks():
    dut = Collaboration("phase_threshold")
    dut.simulator.AdvanceTo(0.5)
    assert np.isnan(dut.output("p_WH")).all()
    assert dut.output("phase")[0] == 0.0
    assert dut.output("human_action")[0] == 1


def test_the_hand_alone_ends_an_action():
    scenario = short_scenario("human.monitor=detector")
    lcm = DrakeLcm("memq://")
    assembly = Assembly(scenario, None, reaction_period=PERIOD, person=TrackedPerson(scenario.lcm, lcm))
    simulator = Simulator(assembly)
    context = simulator.get_mutable_context()
    demonstration = assembly.people.demonstrations[0][0]
    for k in range(1200):
        time = context.get_time()
        lcm.Publish("PACE_HAND", hand(k, demonstration.position(time, 2.2)))
        lcm.HandleSubscriptions(0)
        simulator.AdvanceTo((k + 1) * PERIOD)
        if assembly.GetOutputPort("human_action").Eval(context)[0] == 2:
            break
    assert assembly.GetOutputPort("human_action").Eval(context)[0] == 2
    assert context.get_time() > 1.0


def test_who_tells_nothing_cannot_be_told_of():
    scenario = short_scenario()
    lcm = DrakeLcm("memq://")
    with pytest.raises(InputError, match=r"^human\.monitor: .* must be detector or button") as raised:
        Assembly(scenario, None, reaction_period=PERIOD, person=TrackedPerson(scenario.lcm, lcm))
    assert "\n" not in str(raised.value)


#: [m] from where the synthetic hands are to where the recordings of these tests are.
ELSEWHERE = np.array([-0.3, 0.25, 0.1])


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A folder with a file of SYNTHETIC recordings, somewhere else in the world than the default workplace."""
    folder = tmp_path_factory.mktemp("people")
    shown = generate_demonstrations(num_subjects=3, num_trials=2).demonstrations
    write_demonstrations(folder / "hands.npz", [replace(d, p_WH=d.p_WH + ELSEWHERE) for d in shown])
    return folder


def follow(scenario, demonstration, until=lambda output: False, rest=0.0):
    """A tracked hand that does what a demonstration shows and then rests: times [s] and phases until then."""
    lcm = DrakeLcm("memq://")
    assembly = Assembly(scenario, None, reaction_period=PERIOD, person=TrackedPerson(scenario.lcm, lcm))
    simulator = Simulator(assembly)
    context = simulator.get_mutable_context()

    def output(name):
        return assembly.GetOutputPort(name).Eval(context)[0]

    times, phases = [], []
    while context.get_time() < demonstration.duration + rest and not until(output):
        time = context.get_time()
        lcm.Publish("PACE_HAND", hand(len(times), demonstration.position(time)))
        lcm.HandleSubscriptions(0)
        simulator.AdvanceTo((len(times) + 1) * PERIOD)
        times.append(time)
        phases.append(output("phase"))
    return np.array(times), np.array(phases)


def test_a_tracked_hand_is_compared_with_recordings_where_they_were_made(recordings):
    """By the Euclidean distance, to which the place matters; if they were moved, the error would be 0.5."""
    path = recordings / "hands.npz"
    scenario = load_scenario(
        "ikea_chair",
        (
            f"human.demonstrations={path}",
            "human.monitor=button",
            "estimator.place_rails={distance: euclidean, gamma: 0.0}",
        ),
    )
    moved = load_people(scenario)
    raw = next(d for d in read_demonstrations(path) if d.name == moved.references[0].name)
    times, phases = follow(scenario, raw)
    assert np.sqrt(np.mean((phases - times / raw.duration) ** 2)) < 0.01
    assert np.linalg.norm(moved.shift) > 0.1
    person = TrackedPerson(scenario.lcm, DrakeLcm("memq://"))
    with pytest.raises(InputError, match=r"^human\.workplace: recordings were moved there") as raised:
        Assembly(scenario, None, person=person, people=moved)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("demonstrations", ["synthetic", "hands.npz"])
def test_an_estimator_file_says_where_a_tracked_hand_s_actions_end(recordings, tmp_path, demonstrations):
    """Whoever else the scenario names: SYNTHETIC people come to rest somewhere else, as ends would be said late."""
    signals = folder_signals(recordings)
    settings = [Setting("euclidean", 0.05, 1.0, 0) for _ in signals.actions]
    tuned = [Tuned(setting, 0.0, 0.0, 1) for setting in settings]
    write_estimator_file(tmp_path / "tuned.yaml", estimator_file(signals, tuned))
    named = demonstrations if demonstrations == "synthetic" else recordings / demonstrations
    scenario = load_scenario(
        "ikea_chair",
        (
            f"human.demonstrations={named}",
            "human.monitor=detector",
            f"estimator_file={tmp_path / 'tuned.yaml'}",
            "estimator.place_rails.fused=true",
        ),
    )
    rails = generate_demonstrations(num_subjects=3, num_trials=2).of("place_rails")[-1]
    demonstration = replace(rails, p_WH=rails.p_WH + ELSEWHERE)
    times, _ = follow(scenario, demonstration, lambda output: output("human_action") == 2, rest=10.0)
    assert abs(times[-1] - demonstration.duration) < 1.0


def obedient_arm(home):
    """A station whose arm is where it should be."""
    builder = DiagramBuilder()
    ports = (("panda.position", "panda.position_measured", 7), ("gripper.position", "gripper.unused", 1))
    for name, measured, size in (*ports, ("p_WH", "p_WH_unused", 3)):
        through = builder.AddNamedSystem(name, PassThrough(size))
        builder.ExportInput(through.get_input_port(), name)
        builder.ExportOutput(through.get_output_port(), measured)
    station = builder.Build()
    station.set_name("station")
    return station


@pytest.fixture(scope="module")
def motions():
    from pace_drake.stations.motions import plan_motions

    scenario = short_scenario()
    return plan_motions(scenario.workcell, scenario.task.num_robot_tasks, scenario.task.num_joint_actions)


def test_a_hand_that_falls_silent_stops_the_arm_until_it_is_back_and_acknowledged(motions):
    dut = Collaboration("never", station=obedient_arm(motions.home), motions=motions)
    assembly = dut.assembly
    assert isinstance(assembly.human, ObservedPerson)
    assert not any(assembly.HasInputPort(name) for name in ("hand_age", "stop", "ack", "button"))
    assert assembly.HasInputPort("fault")

    def stopped():
        return bool(dut.output("safety_stop")[0])

    dut.live()  # the first sample is there before the start
    dut.simulator.Initialize()
    dut.run(until=lambda: dut.time > 0.5)
    assert not stopped()
    assert dut.output("robot_action")[0] == ActionKind.ROBOT_TASK
    silent_since = dut.time
    dut.simulator.AdvanceTo(silent_since + 0.19)
    assert not stopped()
    dut.simulator.AdvanceTo(silent_since + 0.25)
    assert stopped()
    assert dut.output("robot_action")[0] == ActionKind.HOLD
    dut.step_number = round(dut.time / PERIOD)
    dut.run(until=lambda: dut.time > silent_since + 1.0)
    assert stopped()
    dut.press(ACKNOWLEDGE)
    dut.run(until=lambda: not stopped(), limit=silent_since + 2.0)
    dut.run(until=lambda: dut.output("robot_action")[0] == ActionKind.ROBOT_TASK, limit=silent_since + 3.0)


def test_without_a_hand_from_the_start_the_arm_never_moves(motions):
    dut = Collaboration("never", station=obedient_arm(motions.home), motions=motions)
    dut.simulator.AdvanceTo(1.0)
    assert dut.output("safety_stop")[0] == 1
    assert dut.output("robot_action")[0] == ActionKind.NONE
    np.testing.assert_array_equal(dut.output("panda.position_measured"), motions.home)


def test_what_a_person_does_not_put_out_is_entered_from_outside():
    scenario = short_scenario("human.monitor=button")
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource([0.5, 0.0, 0.25]))
    builder.ExportOutput(source.get_output_port(), "p_WH")
    dut = Assembly(scenario, None, reaction_period=PERIOD, person=builder.Build())
    assert all(dut.HasInputPort(name) for name in ("assist", "stop", "ack", "button"))
