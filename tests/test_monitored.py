"""The diagram without ground truth: the robot follows the person by the hand, or by a button."""

import numpy as np
import pytest

from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation, Stop


def simulation(monitor, policy="always", *overrides):
    scenario = load_scenario("ikea_chair", (f"human.monitor={monitor}", f"policy={policy}", *overrides))
    return Simulation(Assembly(scenario, make_policy(policy, scenario)))


def costs(dut, num):
    rng = np.random.default_rng(3)
    found = []
    for _ in range(num):
        dut.reset(dut.sample_episode(rng))
        assert dut.run()
        found.append(dut.output("cost")[0])
    return np.array(found)


def test_an_end_that_is_detected_costs_its_delay():
    told, detected = costs(simulation("told"), 9), costs(simulation("detector"), 9)
    # With this policy the robot mostly waits: at three joint actions both wait for the delay, at weights 1 + 3.
    assert (detected > told).all()
    assert np.median(detected - told) < 3 * 4 * 1.0
    # With some people an end is missed and noticed much later (docs/estimator.md).
    assert (detected - told > 3 * 4 * 3.0).sum() <= 1


def test_the_button_stands_in_for_the_truth():
    truth = costs(simulation("told"), 1)
    dut = simulation("button")
    dut.reset(dut.sample_episode(np.random.default_rng(3)))
    human = dut.assembly.human
    context = human.GetMyContextFromRoot(dut.context)
    alpha = set(dut.assembly.scenario.task.human_index_of_joint)
    button = dut.assembly.GetInputPort("button")
    button.FixValue(dut.context, 0.0)
    presses, before = 0, 1
    next_event_time = human.GetOutputPort("next_event_time")
    # While waiting the person has no event of their own.
    while dut.advance(min(next_event_time.Eval(context)[0], dut.time + 1.0)) is not Stop.FINISHED:
        assert dut.time < 500.0
        action = int(dut.output("human_action")[0])
        if action > before and before not in alpha:
            presses += 1
            button.FixValue(dut.context, float(presses))
            dut.interrupt()
        before = action
    # The robot looks at the button with the tracker's period, so that each wait may be 0.1 s longer.
    assert truth[0] <= dut.output("cost")[0] <= truth[0] + 3 * 4 * 0.1 + 1e-6


def test_adapter_and_policy_inside_see_the_same():
    inside = simulation("detector", "phase")
    outside = Simulation(Assembly(inside.assembly.scenario, None))
    episode = inside.sample_episode(np.random.default_rng(0))
    inside.reset(episode)
    inside.run()
    outside.reset(episode)
    policy = inside.assembly.decision
    decide = make_policy("phase", inside.assembly.scenario)
    while outside.advance() is Stop.DECISION:
        outside.decide(decide.decide(outside.output("observation")))
    assert policy is not None
    assert outside.time == inside.time
    assert (outside.output("robot_idle") == inside.output("robot_idle")).all()
    assert (outside.output("human_idle") == inside.output("human_idle")).all()


def test_the_filters_phase_can_be_the_policys():
    names = ("place_rails", "place_screws", "tighten_screws")
    # With the same alignments: an ensemble stands under a fused phase only.
    settings = [f"estimator.{name}.{key}" for name in names for key in ("fused=true", "ensemble=false")]
    plain = simulation("told", "phase")
    fused = simulation("told", "phase", *settings)
    episode = plain.sample_episode(np.random.default_rng(0))
    for dut in (plain, fused):
        dut.reset(episode)
        dut.advance(boundary=10.0)
    assert plain.output("phase") != fused.output("phase")
    assert plain.output("phase_rate") == fused.output("phase_rate")
    mean, std = fused.output("remaining_time")
    assert fused.output("phase")[0] == pytest.approx(10.0 * fused.output("phase_rate")[0], rel=0.02)
    assert abs(mean - (episode.human[0] - 10.0)) < 4 * std


def test_what_nothing_calibrates_is_refused(tmp_path):
    from pace_drake.demos import generate_demonstrations, write_demonstrations

    path = tmp_path / "hand.npz"
    write_demonstrations(path, generate_demonstrations(num_subjects=2, num_trials=2).demonstrations)
    with pytest.raises(InputError, match=r"human\.monitor"):
        simulation("detector", "always", f"human.demonstrations={path}")
    with pytest.raises(InputError, match=r"estimator\.place_rails\.fused"):
        simulation("told", "always", f"human.demonstrations={path}", "estimator.place_rails.fused=true")
    with pytest.raises(InputError, match=r"human\.monitor"):
        simulation("guessed")
