import numpy as np
import pytest

from pace_drake.demos import generate_demonstrations
from pace_drake.demos.generator import _styles
from pace_drake.errors import InputError

MEAN_DURATION = {"place_rails": 22.0, "place_screws": 18.0, "tighten_screws": 40.0}  # [s] the paper's


@pytest.fixture(scope="module")
def demos():
    return generate_demonstrations()


def test_default_set_is_that_of_the_paper_and_says_that_it_is_synthetic(demos):
    assert demos.actions == tuple(MEAN_DURATION)
    for action in demos.actions:
        assert len(demos.of(action)) == 20
        assert len({(d.subject, d.trial) for d in demos.of(action)}) == 20
        assert demos.reference(action).trial == "reference"
        assert demos.reference(action).subject in {d.subject for d in demos.of(action)}
        assert len(demos.split("train").of(action)) == 15
    for demo in (*demos.demonstrations, *demos.references):
        assert demo.synthetic
        assert demo.sample_period == 0.1


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("action", MEAN_DURATION)
def test_durations_vary_about_the_means_of_the_paper(action, seed):
    demos = generate_demonstrations(seed=seed)
    durations = np.array([d.duration for d in demos.of(action)])
    assert np.mean(durations) == pytest.approx(MEAN_DURATION[action], rel=0.12)
    assert 0.10 < np.std(durations, ddof=1) / np.mean(durations) < 0.30
    # Both people and their trials differ.
    by_subject = durations.reshape(5, 4)
    assert np.std(by_subject.mean(axis=1)) > 0.05 * durations.mean()
    assert (np.std(by_subject, axis=1) > 0.01 * durations.mean()).all()


def test_same_seed_same_demonstrations_and_another_seed_others(demos):
    again, other = generate_demonstrations(), generate_demonstrations(seed=1234)
    for a, b in zip(
        (*demos.demonstrations, *demos.references), (*again.demonstrations, *again.references), strict=True
    ):
        assert a.name == b.name
        np.testing.assert_array_equal(a.p_WH, b.p_WH)
    assert not any(
        np.array_equal(a.p_WH, b.p_WH) for a, b in zip(demos.demonstrations, other.demonstrations, strict=True)
    )


def test_another_seed_means_other_people():
    ours, theirs = _styles(0, 5), _styles(1, 5)
    for a, b in zip(ours, theirs, strict=True):
        assert a.skew != b.skew
        assert not np.array_equal(a.places["holes"], b.places["holes"])
    assert sorted(style.tempo for style in ours) == sorted(style.tempo for style in theirs)


def test_global_random_state_is_neither_used_nor_changed(demos):
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    again = generate_demonstrations()
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002
    np.testing.assert_array_equal(again.demonstrations[0].p_WH, demos.demonstrations[0].p_WH)


def test_another_trial_leaves_the_first_ones_as_they_were(demos):
    more = generate_demonstrations(num_trials=5)
    for action in demos.actions:
        first = [d for d in more.of(action) if d.trial != "T5"]
        for a, b in zip(demos.of(action), first, strict=True):
            np.testing.assert_array_equal(a.p_WH, b.p_WH)


def test_hand_stays_in_the_work_space_above_the_table(demos):
    positions = np.concatenate([d.p_WH for d in demos.demonstrations])
    assert (positions.min(axis=0) > [0.60, -0.40, 0.0]).all()
    assert (positions.max(axis=0) < [1.10, 0.40, 0.45]).all()


def test_hand_moves_like_a_hand(demos):
    for demo in demos.demonstrations:
        speeds = np.linalg.norm(np.diff(demo.p_WH, axis=0), axis=1) / demo.sample_period
        assert 0.02 < np.median(speeds) < 0.6  # [m/s]
        assert speeds.max() < 3.0


def nearest_on(path, positions):
    """Distances [m] from positions to the polyline through a path."""
    a, ab = path[:-1], np.diff(path, axis=0)
    to = positions[:, np.newaxis] - a
    t = np.clip((to * ab).sum(axis=2) / np.maximum((ab * ab).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.linalg.norm(to - t[..., np.newaxis] * ab, axis=2).min(axis=1)


def test_no_trial_is_a_warp_of_the_reference(demos):
    """No warp of the time axis, linear or not, leaves the path of the reference; nor does a shifted one."""
    for action in demos.actions:
        reference = demos.reference(action).p_WH
        for demo in demos.of(action):
            # Linear warp, even with the best offset and scale per axis: all correlations would be about 1.
            u = np.linspace(0.0, 1.0, demo.num_samples)
            warped = np.stack(
                [np.interp(u, np.linspace(0.0, 1.0, len(reference)), axis) for axis in reference.T], axis=1
            )
            correlations = [np.corrcoef(warped[:, k], demo.p_WH[:, k])[0, 1] for k in range(3)]
            assert min(correlations) < 0.90, demo.name
            # Any warp: the samples would lie on the reference's polyline, but for noise of about 2 mm.
            centred = demo.p_WH - demo.p_WH.mean(axis=0) + reference.mean(axis=0)
            for path in (demo.p_WH, centred):
                assert np.sqrt(np.mean(nearest_on(reference, path) ** 2)) > 0.006, demo.name


def test_screwing_is_cyclic_and_people_turn_differently_often(demos):
    """The dominant frequency of screwing is that of a turn, about 1 / 1.2 s; its cycles differ in number."""
    cycles = []
    for demo in demos.of("tighten_screws"):
        x = demo.p_WH[:, 0] - demo.p_WH[:, 0].mean()
        spectrum = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
        frequencies = np.fft.rfftfreq(len(x), demo.sample_period)
        band = (frequencies > 0.35) & (frequencies < 2.5)
        peak = frequencies[band][np.argmax(spectrum[band])]
        cycles.append(peak * demo.duration)
    assert 22 < np.median(cycles) < 40
    assert np.std(cycles) > 1.0


def test_sample_period_changes_the_sampling_only():
    coarse, fine = (
        generate_demonstrations(num_trials=1),
        generate_demonstrations(num_trials=1, sample_period=0.05),
    )
    for a, b in zip(coarse.demonstrations, fine.demonstrations, strict=True):
        assert a.duration == pytest.approx(b.duration, abs=0.1)
        # Up to the sensor's offset and noise, which are drawn anew.
        difference = a.p_WH - b.p_WH[::2][: a.num_samples]
        assert np.std(difference, axis=0).max() < 0.005


@pytest.mark.parametrize(
    "arguments",
    [{"seed": -1}, {"num_subjects": 0}, {"num_trials": 0}, {"sample_period": 0.0}, {"sample_period": 0.105}],
)
def test_bad_arguments_are_named(arguments):
    with pytest.raises(InputError, match=next(iter(arguments))):
        generate_demonstrations(**arguments)
