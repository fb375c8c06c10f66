"""pace hand: publishes a person's hand; with a robot, somebody who waits for it and presses the button."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator

from pace_drake.demos import generate_demonstrations, write_demonstrations
from pace_drake.diagram import Assembly
from pace_drake.lcm.types import lcmt_pace_hand, lcmt_pace_operator, lcmt_pace_state
from pace_drake.policies.factory import make_policy
from pace_drake.systems.tracked_person import TrackedPerson
from tests.cli.test_operator import URL
from tests.cli.test_run import pace, refused
from tests.short_scenario import short_scenario

#: As fast as it goes.
FAST = ("--lcm-url", URL, "--speed", 1e6)


@pytest.fixture
def lcm(monkeypatch):
    """Where the verb publishes: a queue of this process."""
    lcm = DrakeLcm("memq://")
    monkeypatch.setattr("pace_drake.lcm.url.open_lcm", lambda config: lcm)
    return lcm


@pytest.fixture
def short(tmp_path):
    path = tmp_path / "short.yaml"
    path.write_text(short_scenario().to_yaml())
    return path


def heard(lcm, channel, lcm_type):
    messages = []
    lcm.Subscribe(channel, lambda data: messages.append(lcm_type.decode(data)))
    return messages


def test_a_synthetic_person_is_called_so_and_works_through_the_task(lcm, short, capsys):
    samples, presses = heard(lcm, "PACE_HAND", lcmt_pace_hand), heard(lcm, "PACE_OPERATOR", lcmt_pace_operator)
    marks = []
    lcm.Subscribe("PACE_HAND_SYNTHETIC", marks.append)
    assert pace("hand", short, *FAST, "--rate", 50) == 0
    said = capsys.readouterr().out
    lcm.HandleSubscriptions(0)
    assert "SYNTHETIC" in said
    assert len(marks) == len(samples)  # and whoever records the hand hears it, too
    assert marks[0].startswith(b"SYNTHETIC")
    assert f"{len(samples)} samples sent" in said
    assert [sample.sequence for sample in samples] == list(range(len(samples)))
    assert 50 * 5 < len(samples) < 50 * 25  # the actions take 11.5 s on average
    steps = np.linalg.norm(np.diff([sample.p_WH for sample in samples], axis=0), axis=1)
    assert 0 < steps.max() < 0.5
    assert presses == []


def test_the_same_seed_is_the_same_motion(lcm, short):
    def motion(*options):
        samples = heard(lcm, "PACE_HAND", lcmt_pace_hand)
        assert pace("hand", short, *FAST, *options) == 0
        lcm.HandleSubscriptions(0)
        return [sample.p_WH for sample in samples]

    assert motion("--seed", 3) == motion("--seed", 3)
    assert motion("--seed", 3) != motion("--seed", 4)


def test_a_recording_is_played(lcm, short, tmp_path, capsys):
    path = tmp_path / "hand.csv"
    recorded = generate_demonstrations(num_subjects=2, num_trials=1).demonstrations
    up = np.array([0.0, 0.0, 1.0])  # [m]
    write_demonstrations(path, [replace(d, p_WH=d.p_WH + up) for d in recorded])  # in another place
    samples = heard(lcm, "HAND", lcmt_pace_hand)
    assert pace("hand", short, *FAST, "--hand", path, "--rate", 10, "--set", "lcm.person_hand_channel=HAND") == 0
    said = capsys.readouterr().out
    assert "hand.csv" in said
    assert "SYNTHETIC" in said  # through a file they are no recordings either
    lcm.HandleSubscriptions(0)
    np.testing.assert_allclose(samples[5].p_WH, recorded[1].p_WH[5] + up, atol=1e-6)  # and not moved
    assert len(samples) > 300  # as long as the recordings, not as the scenario's durations


def test_a_person_with_a_robot_completes_a_collaboration(lcm, short, monkeypatch):
    scenario = short_scenario("human.monitor=button")
    for assistance in scenario.task.assistances:
        assistance.preparation.mean = 5.0  # [s] the person is always there first
    assembly = Assembly(
        scenario,
        make_policy("always", scenario),
        reaction_period=0.01,
        person=TrackedPerson(scenario.lcm, lcm),
        lcm=lcm,
    )
    simulator = Simulator(assembly)
    context = simulator.get_mutable_context()
    assembly.set_episode(context, assembly.people.sample(scenario, np.random.default_rng(0)))
    joints_done = assembly.human.GetOutputPort("joints_done")
    own_context = assembly.human.GetMyContextFromRoot(context)
    presses = []  # what was pressed, after how many joint actions
    lcm.Subscribe(
        "PACE_OPERATOR",
        lambda data: presses.append((lcmt_pace_operator.decode(data).event, joints_done.Eval(own_context)[0])),
    )

    def in_the_meantime(seconds):
        assert seconds >= 0
        assert context.get_time() < 100.0
        lcm.HandleSubscriptions(0)
        simulator.AdvanceTo(context.get_time() + 0.02)

    monkeypatch.setattr("time.sleep", in_the_meantime)
    assert pace("hand", short, *FAST, "--rate", 50, "--with-robot") == 0
    while not assembly.GetOutputPort("finished").Eval(context)[0]:
        in_the_meantime(0.0)
    assert presses == [(lcmt_pace_operator.REQUEST, joint) for joint in range(3)]
    assert joints_done.Eval(own_context)[0] == 3
    assert (assembly.GetOutputPort("human_idle").Eval(context) > 1.0).all()


def test_a_person_with_a_robot_keeps_still_until_it_begins(lcm, short, monkeypatch):
    state = lcmt_pace_state()
    state.leaf = "READY"
    samples, ticks = heard(lcm, "PACE_HAND", lcmt_pace_hand), []

    def in_the_meantime(seconds):
        ticks.append(seconds)
        state.utime = len(ticks)
        state.leaf = "READY" if len(ticks) < 50 else "ROBOT_TASK"
        lcm.Publish("PACE_STATE", state.encode())
        if len(ticks) == 60:
            raise KeyboardInterrupt
        lcm.HandleSubscriptions(0)

    monkeypatch.setattr("time.sleep", in_the_meantime)
    assert pace("hand", short, *FAST, "--rate", 50, "--with-robot") == 130
    lcm.HandleSubscriptions(0)
    places = np.array([sample.p_WH for sample in samples])
    assert len(np.unique(places[:50], axis=0)) == 1
    assert len(np.unique(places, axis=0)) > 5


def test_an_interrupted_hand_says_how_far_it_came(lcm, short, monkeypatch, capsys):
    def interrupt(seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr("time.sleep", interrupt)
    assert pace("hand", short, *FAST) == 130
    assert "0 samples are sent" in capsys.readouterr().err


def test_bad_input(capsys, tmp_path):
    assert "--lcm-url" in refused(capsys, "hand")
    assert "must begin with memq://" in refused(capsys, "hand", "--lcm-url", "PANDA")
    assert "unknown scenario" in refused(capsys, "hand", "no_scenario", "--lcm-url", URL)
    assert "no such file" in refused(capsys, "hand", "--lcm-url", URL, "--hand", tmp_path / "no.csv")
    assert "must be numbers" in refused(capsys, "hand", "--lcm-url", URL, "--rate", "nan")
    assert "range" in refused(capsys, "hand", "--lcm-url", URL, "--speed", 0)
    assert "--rate" in refused(capsys, "hand", "--lcm-url", URL, "--rate", 1e9)
    assert "memq:// reaches nobody outside this process" in refused(capsys, "hand", "--lcm-url", "memq://null")
