import shutil
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.demos import (
    ActionSignals,
    Demonstration,
    Signal,
    SignalSet,
    folder_signals,
    signal_of,
    signals,
    synthetic_signals,
    watch_signals,
    write_demonstrations,
)
from pace_drake.errors import InputError

GOOD = {"action": "a", "subject": "S1", "trial": "T1", "sample_period": 0.1, "values": np.eye(3, 2), "synthetic": False}


def signal(subject, trial="T1", **changes):
    return Signal(**(GOOD | {"subject": subject, "trial": trial} | changes))


def names(part):
    return [f"{one.subject}/{one.trial}" for one in part]


@pytest.fixture
def folder(tmp_path):
    """Makes a folder of CSV files, one per action, from `action=["S1/T1", "S1/T2", ...]`."""

    def folder(**actions):
        for action, labels in actions.items():
            write_demonstrations(
                tmp_path / f"{action}.csv",
                [
                    Demonstration(action, *label.split("/"), 0.1, np.eye(3) + k, synthetic=False)
                    for k, label in enumerate(labels)
                ],
            )
        return tmp_path

    return folder


# --- signals and sets ---


def test_a_signal_has_any_number_of_axes_and_cannot_be_changed():
    values = np.ones((4, 7))
    one = signal("S1", values=values)
    values[:] = 0.0
    assert (one.values == 1.0).all()
    assert one.name == "a/S1/T1"
    with pytest.raises(ValueError, match="read-only"):
        one.values[0, 0] = 2.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"action": ""}, "action: must be a text, got ''"),
        ({"subject": "two\nlines"}, "subject: must be a text"),
        ({"trial": 1}, "trial: must be a text, got 1"),
        ({"sample_period": 0.0}, "a/S1/T1: sample_period must be > 0 s, got 0.0"),
        ({"sample_period": np.nan}, "a/S1/T1: sample_period must be > 0 s, got nan"),
        ({"values": [["x"]]}, "a/S1/T1: values must be an .m, d. array of numbers"),
        ({"values": np.zeros(3)}, r"with m >= 2 and d >= 1, got \(3,\)"),
        ({"values": np.zeros((1, 3))}, r"with m >= 2 and d >= 1, got \(1, 3\)"),
        ({"values": np.zeros((3, 0))}, r"with m >= 2 and d >= 1, got \(3, 0\)"),
        ({"values": [[0.0], [np.nan], [0.0]]}, "NaN or inf in row 1: interpolate or cut it"),
        ({"values": [[0.0], [0.0], [-np.inf]]}, "NaN or inf in row 2"),
    ],
)
def test_a_signal_out_of_range_is_refused(change, message):
    with pytest.raises(InputError, match=message) as error:
        Signal(**(GOOD | change))
    assert "\n" not in str(error.value)


def test_a_demonstration_as_a_signal():
    demonstration = Demonstration("a", "S1", "T1", 0.2, np.eye(3), synthetic=True)
    one = signal_of(demonstration)
    assert (one.name, one.sample_period, one.synthetic) == (demonstration.name, 0.2, True)
    np.testing.assert_array_equal(one.values, demonstration.p_WH)


S1, S2, OTHER = (signal("S1"), signal("S1", "T2")), signal("S1", "T3"), signal("S2")


@pytest.mark.parametrize(
    ("train", "trials", "people", "message"),
    [
        (S1[:1], (), (OTHER,), "needs at least 2 training signals, got 1: record more trials, or hold out fewer"),
        (S1, (), (), "has nothing held out to evaluate with"),
        (S1, (S1[0],), (), "2 signals are called 'a/S1/T1'"),
        (S1, (), (replace(OTHER, action="b"),), "b/S2/T1 belongs to another action"),
        (S1, (), (replace(OTHER, sample_period=0.2),), "a/S2/T1 and a/S1/T1 must have the same sample period"),
        (
            S1,
            (),
            (replace(OTHER, values=np.eye(3)),),
            "a/S2/T1 and a/S1/T1 must have the same sample period and number",
        ),
        (S1, (OTHER,), (), "a/S2/T1 is a held-out trial of a person not in train"),
        (S1, (), (S2,), "a/S1/T3 is of a held-out person, who is in train"),
    ],
)
def test_parts_that_would_make_an_evaluation_wrong_are_refused(train, trials, people, message):
    with pytest.raises(InputError, match=f"^action 'a': .*{message}"):
        ActionSignals("a", train, trials, people)


def test_a_set_says_what_it_is():
    one = ActionSignals("a", S1, (S2,), (OTHER,))
    data = SignalSet("paths", "a test", "none", "m", (one,))
    assert data.description == "paths: 1 action, 2 training signals, 1 held-out trials, 1 signals of held-out people"
    assert not data.synthetic
    made = replace(one, heldout_people=(replace(OTHER, synthetic=True),))
    assert replace(data, actions=(made,)).description.startswith("SYNTHETIC paths: ")
    with pytest.raises(InputError, match="paths: has no action"):
        replace(data, actions=())
    with pytest.raises(InputError, match="an action stands twice in a, a"):
        replace(data, actions=(one, one))


# --- synthetic ---


def test_synthetic_signals():
    data = synthetic_signals()
    assert data.description.startswith("SYNTHETIC ")
    assert [one.action for one in data.actions] == ["place_rails", "place_screws", "tighten_screws"]
    for one in data.actions:
        assert names(one.train)[:-1] == [f"S{k}/T{t}" for k in range(1, 6) for t in (1, 2, 3)]
        assert names(one.train)[-1].endswith("/reference")
        assert names(one.heldout_trials) == [f"S{k}/T4" for k in range(1, 6)]
        assert names(one.heldout_people) == [f"S{k}/T{t}" for k in range(6, 11) for t in (1, 2, 3, 4)]
        assert len({s.values.tobytes() for s in one.signals}) == 41  # no signal stands in two parts
        assert all(s.synthetic and s.sample_period == 0.1 for s in one.signals)


def test_the_seed_decides():
    def values(seed):
        return [s.values.tobytes() for one in synthetic_signals(seed).actions for s in one.signals]

    assert values(3) == values(3)
    assert not set(values(3)) & set(values(4))
    with pytest.raises(InputError, match="seed"):
        synthetic_signals(-1)


# --- the watch ---


@given(st.integers(1, 40), st.integers(1, 7))
@settings(max_examples=50, deadline=None)
def test_thinning_is_every_nth_of_a_trailing_mean(num_samples, stride):
    values = np.random.default_rng(num_samples).normal(size=(num_samples, 2))
    means = [values[max(0, k - stride + 1) : k + 1].mean(axis=0) for k in range(num_samples)]
    np.testing.assert_allclose(signals._thinned(values, stride), [values[0], *means[stride::stride]], atol=1e-12)


@pytest.fixture(scope="module")
def right():
    try:
        version("seglearn")
    except PackageNotFoundError:
        pytest.skip("extra 'data' (seglearn) is not installed")
    return watch_signals()


def test_watch_signals(right):
    assert right.description == (
        "accelerations of the right wrist in sets of 20 shoulder exercises: "
        "7 actions, 49 training signals, 0 held-out trials, 21 signals of held-out people"
    )
    assert [one.action for one in right.actions] == ["ABD", "ER", "FEL", "IR", "PEN", "ROW", "TRAP"]
    for one in right.actions:
        assert names(one.train) == [f"S{k:02d}/right" for k in range(1, 8)]
        assert names(one.heldout_people) == ["S08/right", "S09/right", "S10/right"]
        assert all(s.sample_period == 0.1 and s.values.shape[1] == 3 and not s.synthetic for s in one.signals)


def test_watch_signals_are_those_of_the_shared_recordings(right, shared_data):
    for one in right.actions:
        with np.load(shared_data / "hand" / f"watch_{one.action}.npz") as file:
            recorded = np.split(file["x"], np.cumsum(file["length"])[:-1])
            expected = dict(zip(file["subject"].tolist(), recorded, strict=True))
        assert sorted(expected) == [s.subject for s in one.train]
        for s in one.train:
            np.testing.assert_array_equal(s.values.astype(np.float32), expected[s.subject])


def test_the_other_side_is_another_recording(right):
    left = watch_signals("left")
    for one, other in zip(left.actions, right.actions, strict=True):
        assert [s.subject for s in one.signals] == [s.subject for s in other.signals]
        assert not {s.values.tobytes() for s in one.signals} & {s.values.tobytes() for s in other.signals}


def test_a_side_that_nobody_has():
    with pytest.raises(InputError, match="side: must be right or left, got 'both'"):
        watch_signals("both")


# --- a folder ---


def test_a_folder_of_two_people(folder):
    data = folder_signals(folder(pour=["A/1", "A/2", "B/1", "B/2"], lift=["B/1", "A/1", "A/2", "A/3"]))
    lift, pour = data.actions
    assert (lift.action, pour.action) == ("lift", "pour")
    assert (names(lift.train), names(lift.heldout_trials), names(lift.heldout_people)) == (
        ["A/1", "A/2"],
        ["A/3"],
        ["B/1"],
    )
    assert (names(pour.train), names(pour.heldout_trials), names(pour.heldout_people)) == (
        ["A/1", "A/2"],  # of two trials none is held out
        [],
        ["B/1", "B/2"],
    )


@pytest.mark.parametrize(("num_people", "heldout"), [(3, 1), (4, 2), (6, 2), (7, 3)])
def test_the_last_30_percent_of_the_people_are_held_out(folder, num_people, heldout):
    people = [f"P{k}" for k in range(num_people)]
    (one,) = folder_signals(folder(pour=[f"{person}/1" for person in reversed(people)])).actions
    assert {s.subject for s in one.heldout_people} == set(people[-heldout:])
    assert {s.subject for s in one.train} == set(people[:-heldout])


def test_people_are_held_out_by_name(folder):
    path = folder(pour=["A/1", "B/1", "B/2", "B/3"])
    (one,) = folder_signals(path, heldout=["A"]).actions
    assert (names(one.train), names(one.heldout_trials), names(one.heldout_people)) == (
        ["B/1", "B/2"],
        ["B/3"],
        ["A/1"],
    )
    (one,) = folder_signals(path, heldout=()).actions
    assert (names(one.train), names(one.heldout_trials), one.heldout_people) == (["A/1", "B/1", "B/2"], ["B/3"], ())
    with pytest.raises(InputError, match=r"heldout: nobody is called 'C', there are: A, B"):
        folder_signals(path, heldout=["C"])


def test_signals_of_a_folder_are_resampled(folder):
    (one,) = folder_signals(folder(pour=["A/1", "A/2", "B/1"]), period=0.05).actions
    assert one.train[0].sample_period == 0.05
    np.testing.assert_allclose(one.train[0].values[:3], [[1, 0, 0], [0.5, 0.5, 0], [0, 1, 0]])


def refused(path, message, **options):
    with pytest.raises(InputError, match=message) as error:
        folder_signals(path, **options)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(str(path))


def test_a_folder_that_cannot_be_used(folder, tmp_path):
    refused(tmp_path / "absent", "no such folder")
    refused(tmp_path, "holds no .npz or .csv file")
    path = folder(pour=["A/1", "B/1"])
    refused(path, "action 'pour': needs at least 2 training signals, got 1")
    refused(path, "action 'pour': has nothing held out", heldout=())
    refused(path, "pour.csv: pour/A/1: sample_period must be at most 0.2 s, got 5.0", period=5.0)
    with pytest.raises(InputError, match="period: must be > 0 s, got nan"):
        folder_signals(path, period=np.nan)
    shutil.copy(path / "pour.csv", path / "copy.csv")
    refused(path, "2 signals are called 'pour/A/1', give each its own subject or trial", heldout=["B"])
    (path / "broken.csv").write_text("time,x,y,z\n0,0,0,0\n0.1,0,nan,0\n")
    refused(path, "broken.csv: line 3, column y is nan")


def test_real_recordings_in_a_folder(shared_data, tmp_path):
    for name in ("lego_task1", "lego_task2", "watch_ABD"):
        shutil.copy(shared_data / "hand" / f"{name}.npz", tmp_path)
    (tmp_path / "LICENSE.lego").write_text("MIT")
    lego, _, watch = folder_signals(tmp_path, heldout=["H2", "S06", "S07"]).actions
    assert names(lego.train) == ["H1/trial1", "H1/trial2"]
    assert names(lego.heldout_people) == ["H2/trial1", "H2/trial2"]
    assert [len(s.values) for s in lego.signals] == [309, 349, 515, 285]  # 10 Hz, from 30 Hz
    assert {s.subject for s in watch.train} == {"S01", "S02", "S03", "S04", "S05"}
    shutil.copy(shared_data / "hand" / "lego_task3.npz", tmp_path)
    with pytest.raises(InputError, match=r"lego_task3.npz: x has NaN or inf in row 3875 .*, interpolate or cut it$"):
        folder_signals(tmp_path)
