import numpy as np
import pytest

from pace_drake.demos import Demonstration, DemonstrationSet
from pace_drake.errors import InputError

PATH = np.random.default_rng(0).normal(size=(11, 3))


def demonstration(action="rails", subject="S1", trial="T1", period=0.1, path=PATH):
    return Demonstration(action, subject, trial, period, path, synthetic=True)


def test_duration_is_from_first_to_last_sample():
    demo = demonstration()
    assert demo.duration == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(demo.times, np.linspace(0.0, 1.0, 11))


def test_path_is_a_read_only_copy():
    path = PATH.copy()
    demo = demonstration(path=path)
    path[:] = 0.0
    np.testing.assert_array_equal(demo.p_WH, PATH)
    with pytest.raises(ValueError, match="read-only"):
        demo.p_WH[0, 0] = 1.0


@pytest.mark.parametrize("duration", [None, 1.0, 0.37, 25.0])
def test_position_rescales_the_time_axis(duration):
    demo = demonstration()
    actual = duration or demo.duration
    for time in np.linspace(0.0, actual, 37):
        expected = [np.interp(time / actual, np.linspace(0.0, 1.0, 11), axis) for axis in PATH.T]
        np.testing.assert_allclose(demo.position(time, duration), expected, atol=1e-12)


def test_position_holds_the_ends():
    demo = demonstration()
    for time, row in [(-1.0, 0), (0.0, 0), (2.0, -1), (5.0, -1), (np.inf, -1)]:
        np.testing.assert_array_equal(demo.position(time, 2.0), PATH[row])


def test_position_hits_samples_exactly():
    demo = demonstration(period=0.25)
    for k in range(11):
        np.testing.assert_array_equal(demo.position(0.25 * k), PATH[k])


@pytest.mark.parametrize(("time", "duration"), [(0.0, 0.0), (0.0, -1.0), (0.0, np.nan), (np.nan, 1.0)])
def test_position_refuses_nonsense(time, duration):
    with pytest.raises(InputError, match=r"rails/S1/T1: (duration|time)"):
        demonstration().position(time, duration)


def test_resample_interpolates_and_keeps_the_labels():
    fine = demonstration().resample(0.04)
    assert (fine.action, fine.subject, fine.trial, fine.synthetic) == ("rails", "S1", "T1", True)
    assert fine.sample_period == 0.04
    assert fine.num_samples == 26
    for k, position in enumerate(fine.p_WH):
        np.testing.assert_allclose(position, demonstration().position(0.04 * k), atol=1e-12)


def test_resample_drops_a_remainder_but_not_a_whole_period():
    assert demonstration().resample(0.3).num_samples == 4
    assert demonstration().resample(0.1).num_samples == 11
    assert demonstration(period=1 / 30).resample(0.1).num_samples == 4
    with pytest.raises(InputError, match="sample_period must be at most 1 s, got 2"):
        demonstration().resample(2.0)
    with pytest.raises(InputError, match="sample_period must be > 0 s"):
        demonstration().resample(0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"path": PATH[:1]}, "p_WH must have at least 2 samples, got 1"),
        ({"path": PATH[:, :2]}, r"p_WH must have the shape \(num_samples, 3\), got \(11, 2\)"),
        ({"path": PATH[0]}, r"p_WH must have the shape \(num_samples, 3\)"),
        ({"path": "path"}, "p_WH must be a .* array of numbers"),
        ({"path": np.where(PATH[4, 1] == PATH, np.nan, PATH)}, "p_WH has NaN or inf in row 4"),
        ({"period": 0.0}, "sample_period must be > 0 s, got 0"),
        ({"period": np.inf}, "sample_period must be > 0 s, got inf"),
        ({"action": ""}, "action of a demonstration must be"),
        ({"trial": "a\nb"}, "trial of a demonstration must be"),
    ],
)
def test_bad_demonstrations_are_refused_in_one_line(arguments, message):
    with pytest.raises(InputError, match=message) as error:
        demonstration(**arguments)
    assert "\n" not in str(error.value)


@pytest.fixture
def recordings():
    trials = [
        demonstration(action, subject, f"T{trial}")
        for action in ("rails", "screws")
        for subject in ("S1", "S2")
        for trial in range(1, 5)
    ]
    references = [demonstration(action, "S2", "reference") for action in ("rails", "screws")]
    return DemonstrationSet(tuple(trials), tuple(references))


def test_set_finds_demonstrations_and_references(recordings):
    assert recordings.actions == ("rails", "screws")
    assert recordings.synthetic
    assert len(recordings.of("screws")) == 8
    assert {d.action for d in recordings.of("screws")} == {"screws"}
    assert recordings.reference("screws").name == "screws/S2/reference"
    with pytest.raises(InputError, match="no demonstrations of 'carry', there are: rails, screws"):
        recordings.of("carry")


def test_last_trial_of_each_subject_is_for_validation(recordings):
    train, validation = recordings.split("train"), recordings.split("validation")
    assert [d.name for d in validation.of("rails")] == ["rails/S1/T4", "rails/S2/T4"]
    assert len(train.demonstrations) == 12
    assert {d.trial for d in train.demonstrations} == {"T1", "T2", "T3"}
    assert train.references == validation.references == recordings.references
    assert recordings.split("all").demonstrations == recordings.demonstrations
    with pytest.raises(InputError, match="split must be one of train, validation, all, got 'test'"):
        recordings.split("test")  # type: ignore[arg-type]


def test_an_only_trial_is_for_training():
    only = DemonstrationSet((demonstration(),), (demonstration(trial="reference"),))
    assert len(only.split("train").demonstrations) == 1
    assert not only.split("validation").demonstrations


def test_set_needs_exactly_one_reference_per_action():
    demo, reference = demonstration(), demonstration(trial="reference")
    with pytest.raises(InputError, match="action 'rails' has no reference"):
        DemonstrationSet((demo,), ())
    with pytest.raises(InputError, match="action 'rails' has 2 references"):
        DemonstrationSet((demo,), (reference, demonstration()))
    with pytest.raises(InputError, match="rails/S1/T1 is the reference and a demonstration"):
        DemonstrationSet((demo,), (demo,))


def test_median_length_makes_the_reference():
    demos = [demonstration(trial=str(n), path=np.zeros((n, 3))) for n in (9, 3, 5, 30, 7)]
    chosen = DemonstrationSet.with_median_references(demos)
    assert chosen.reference("rails") is demos[4]
    assert chosen.demonstrations == (demos[0], demos[1], demos[2], demos[3])
    assert DemonstrationSet.with_median_references(demos[:4]).reference("rails") is demos[2]
