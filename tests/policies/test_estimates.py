"""A learned policy is refused where this program shows it another phase of the same people than in training."""

from dataclasses import replace

import numpy as np
import pytest

import pace_drake.people as module
from pace_drake.diagram import Assembly
from pace_drake.dtw.filter import PhaseFilter
from pace_drake.errors import InputError
from pace_drake.evaluate.worlds import evaluate_given
from pace_drake.people import load_people
from pace_drake.policies.estimates import Estimates
from pace_drake.policies.factory import make_policy
from pace_drake.policies.learned import LearnedPolicy
from pace_drake.scenario import load_scenario
from tests.cli.test_run import refused

REFUSED = r"ikea_chair.onnx: trained with another phase estimate of place_rails: phase 0.\d{3}, now 0.\d{3}; train"


@pytest.fixture
def other_program(monkeypatch):
    """Alignments that count cells otherwise, as a later version's might."""
    real = module.make_alignment
    monkeypatch.setattr(module, "make_alignment", lambda *given, **_: real(*given, tempo_free=True))


def estimates(*overrides, observation="paper", change=None, tracked=False):
    scenario = load_scenario("ikea_chair", (f"observation={observation}", *overrides))
    people = load_people(scenario, tracked=tracked)
    estimators = [one if one is None or change is None else change(one) for one in people.estimators(scenario)]
    return Estimates.of(scenario, people, estimators, observation)


def test_another_alignment_is_refused(chair, other_program):
    policy = make_policy("learned", chair)
    with pytest.raises(InputError, match=REFUSED):
        Assembly(chair, policy)
    with pytest.raises(InputError, match=REFUSED):
        evaluate_given(chair, {"learned": policy}, 0, 2)


def test_in_one_line(other_program, capsys):
    assert "train it anew: pace train" in refused(capsys, "run", "--level", "task")


@pytest.mark.parametrize("given", ["human.seed=1", "estimator.place_rails.gamma=0.0", "human.sample_period=0.2"])
def test_what_the_user_asks_for_is_not(given, other_program):
    """Policies are tried with other people and settings, a real person's estimators among them."""
    scenario = load_scenario("ikea_chair", (given,))
    Assembly(scenario, make_policy("learned", scenario))


def test_other_files_are_the_user_s_choice(tmp_path, chair, chair_people):
    from pace_drake.demos import write_demonstrations

    known = estimates().inputs
    seen = {known}
    for number in (2, 3):
        file = tmp_path / "hands.npz"
        write_demonstrations(file, [d for group in chair_people.demonstrations for d in group[:number]])
        seen.add(estimates(f"human.demonstrations={file}").inputs)
    assert len(seen) == 3  # by what is in them
    estimators = chair_people.estimators(chair)
    for text in ("one", "another"):
        (tmp_path / "e.yaml").write_text(text)
        changed = replace(chair, estimator_file=str(tmp_path / "e.yaml"))
        seen.add(Estimates.of(changed, chair_people, estimators, "paper").inputs)
    assert len(seen) == 5
    assert estimates("task.human_actions.0.duration.mean=23.0").inputs != known
    assert estimates("human.split=unseen", "task.human_idle_weight=1.0", "human.workplace=[]").inputs == known


@pytest.mark.parametrize("observation", ["paper", "history"])
def test_the_same_estimators_show_the_same(observation):
    """Whoever plays, in a file or not, and whether or not a person is tracked."""
    plain = ("estimator.place_screws.ensemble=false", "estimator.tighten_screws.ensemble=false")  # fast
    known = estimates(*plain, observation=observation)
    read = Estimates.from_json(known.to_json())
    assert {name: one.shape for name, one in read.values.items()} == {
        name: (5, 1 if observation == "paper" else 3) for name in ("place_rails", "place_screws", "tighten_screws")
    }
    for split in ("train", "unseen"):
        again = estimates(*plain, f"human.split={split}", observation=observation, tracked=True)
        assert read.inputs == again.inputs
        for name, one in again.values.items():
            np.testing.assert_allclose(read.values[name], one, atol=1e-6)
        assert read.difference(again) == ""


def test_another_calibration_of_the_filter():
    plain = [f"estimator.{name}.ensemble=false" for name in ("place_rails", "place_screws", "tighten_screws")]
    known = estimates(*plain, observation="fused")

    def slower(one):
        calibration = one.calibration
        return PhaseFilter(
            one.estimator, replace(calibration, duration_log_mean=calibration.duration_log_mean + 0.02), one.fused
        )

    def surer(one):
        return PhaseFilter(one.estimator, replace(one.calibration, duration_log_std=1e-4), one.fused)

    for change in (slower, surer):
        assert known.difference(estimates(*plain, observation="fused", change=change)).startswith("of place_rails: ")


def test_every_element_counts():
    """An error of 2 in a thousand of any value, or an action that is not there, is seen; half of one is not."""
    known = Estimates("x", {name: np.array([[0.5, 0.05, 20.0]] * 5) for name in ("first", "second")})
    for name in known.values:
        for k in range(15):
            for share, seen in ((5e-4, False), (3e-3, True)):
                values = {key: one.copy() for key, one in known.values.items()}
                values[name].flat[k] += share * (1.0 if k % 3 < 2 else 20.0)
                found = known.difference(Estimates("x", values))
                assert found.startswith(f"of {name}: {('phase', 'phase_std', 'remaining_time')[k % 3]} ") == seen
                assert (found == "") != seen
    assert known.difference(Estimates("x", {"first": known.values["first"]})) == "of second"
    assert known.difference(Estimates("y", {})) == ""


def test_without_a_phase_there_is_nothing_to_say(chair, chair_people):
    assert Estimates.of(chair, chair_people, chair_people.estimators(chair), "none") is None


def written(chair, path, **metadata):
    """The shipped policy with other metadata; None takes an entry away."""
    onnx = pytest.importorskip("onnx", reason="extra 'train' is not installed")
    proto = onnx.load(str(chair.resolve(chair.learned_policy)))
    entries = {entry.key: entry.value for entry in proto.metadata_props} | metadata
    onnx.helper.set_model_props(proto, {key: value for key, value in entries.items() if value is not None})
    onnx.save(proto, str(path))
    return path


def test_files_that_do_not_say(chair, tmp_path):
    """Of older versions, or of somebody else's: the paper's phase is what it was, the filter's is not."""
    policy = LearnedPolicy(written(chair, tmp_path / "paper.onnx", estimates=None), chair.task)
    Assembly(chair, policy)
    for observation in ("fused", "history"):
        path = written(chair, tmp_path / f"{observation}.onnx", estimates=None, observation=observation)
        with pytest.raises(InputError, match=f"{observation}.onnx: does not say what the phase filter showed it"):
            LearnedPolicy(path, chair.task)


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"inputs": "x", "values": {"a": [[0.1]]}}', '{"inputs": "x", "values": {"a": [["b"]]}}']
)
def test_estimates_that_cannot_be_read(text, chair, tmp_path):
    path = written(chair, tmp_path / "own.onnx", estimates=text)
    with pytest.raises(InputError, match=r"own.onnx: what the estimators showed it cannot be read; train it anew"):
        LearnedPolicy(path, chair.task)
