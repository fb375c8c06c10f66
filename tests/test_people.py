"""pace_drake.people: which demonstrations are played and which reference they are compared with."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from pace_drake.demos import Demonstration, generate_demonstrations, write_demonstrations
from pace_drake.dtw.estimator_file import ActionEstimator, EstimatorFile, write_estimator_file
from pace_drake.dtw.filter import Calibration
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.errors import InputError
from pace_drake.people import Person, load_people
from pace_drake.scenario import load_scenario

NAMES = ["place_rails", "carry_side", "place_screws", "hand_key", "tighten_screws", "hand_second_key"]


def recording(subject, trial, seconds, action="assembly"):
    t = np.arange(round(seconds * 10) + 1) / 10
    return Demonstration(action, subject, trial, 0.1, np.column_stack([np.sin(t), t / 10, 0 * t]), synthetic=False)


def people_of(tmp_path, *recordings):
    path = tmp_path / "hand.npz"
    write_demonstrations(path, list(recordings))
    return load_people(load_scenario("ikea_chair", (f"human.demonstrations={path}",)))


def test_synthetic_people_say_so_and_split_as_the_paper_does(chair):
    people = load_people(chair)
    assert people.description.startswith("SYNTHETIC")
    assert people.rescale
    assert [len(group) for group in people.demonstrations] == [5, 0, 5, 0, 5, 0]  # one validation trial a subject
    for name, group, reference in zip(NAMES, people.demonstrations, people.references, strict=True):
        assert (reference is None) == (not group)
        assert all(d.action == name for d in group)
        assert all(d is not reference for d in group)


def test_with_two_people_the_first_gives_the_reference_and_the_other_is_played(tmp_path):
    people = people_of(
        tmp_path,
        recording("A", "1", 30),
        recording("A", "2", 20),
        recording("A", "3", 25),
        recording("B", "1", 22),
        recording("B", "2", 33),
    )
    assert not people.rescale
    for k in (0, 2, 4):
        assert (people.references[k].subject, people.references[k].trial) == ("A", "3")  # median length
        assert [(d.subject, d.trial) for d in people.demonstrations[k]] == [("B", "1"), ("B", "2")]
    assert people.references[1] is None
    assert "reference of A, played: B" in people.description


def test_one_person_s_other_recordings_are_played(tmp_path):
    people = people_of(tmp_path, recording("A", "1", 20), recording("A", "2", 24), recording("A", "3", 28))
    assert people.references[0].trial == "2"
    assert [d.trial for d in people.demonstrations[0]] == ["1", "3"]


def test_a_single_recording_is_compared_with_the_synthetic_people_s_reference(tmp_path, chair):
    people = people_of(tmp_path, recording("A", "1", 20))
    assert "compared with a SYNTHETIC reference" in people.description
    known = load_people(chair).references[0]
    np.testing.assert_array_equal(people.references[0].p_WH, known.p_WH)


def test_labels_choose_the_action(tmp_path):
    people = people_of(
        tmp_path,
        recording("A", "1", 20, "place_rails"),
        recording("B", "1", 21, "place_rails"),
        recording("A", "1", 15, "place_screws"),
        recording("B", "1", 16, "place_screws"),
    )
    assert [d.duration for d in people.demonstrations[0]] == [21.0]
    assert [d.duration for d in people.demonstrations[2]] == [16.0]


def test_recorded_hands_keep_their_durations(tmp_path, chair):
    people = people_of(tmp_path, recording("A", "1", 20), recording("B", "1", 23))
    episode = people.sample(chair, np.random.default_rng(0))
    assert [episode.human[k] for k in (0, 2, 4)] == [23.0, 23.0, 23.0]
    assert episode.human[1] != 23.0  # joint actions are drawn as ever


def test_recordings_are_moved_to_the_workplace_all_by_one_vector(tmp_path):
    first, second = recording("A", "1", 20), recording("B", "1", 23)
    people = people_of(tmp_path, first, second)
    shift = people.references[0].p_WH[0] - first.p_WH[0]
    for moved, original in ((people.references[0], first), (people.demonstrations[0][0], second)):
        np.testing.assert_allclose(moved.p_WH, original.p_WH + shift, atol=1e-12)
    both = np.concatenate([people.references[0].p_WH, people.demonstrations[0][0].p_WH])
    np.testing.assert_allclose(both.mean(axis=0), [0.85, 0.0, 0.15], atol=1e-12)
    path = tmp_path / "hand.npz"
    scenario = load_scenario("ikea_chair", (f"human.demonstrations={path}", "human.workplace=[]"))
    np.testing.assert_array_equal(load_people(scenario).references[0].p_WH, first.p_WH)


def test_an_action_that_the_synthetic_set_does_not_know(chair):
    actions = [replace(chair.task.human_actions[0], name="knit"), *chair.task.human_actions[1:]]
    scenario = replace(chair, task=replace(chair.task, human_actions=actions))
    with pytest.raises(InputError, match="no action 'knit'; it has place_rails"):
        load_people(scenario)


def estimator_file(path, action="place_rails", period=0.1, axes=3):
    """A file with one tuned estimator."""
    reference = np.random.default_rng(0).normal(size=(40, axes))
    calibration = Calibration(3.0, 0.2, (0.0,), (0.0,), (0.1,))
    tuned = ActionEstimator("wp", 0.5, 1.0, "S1/1", reference, calibration, {})
    write_estimator_file(path, EstimatorFile("test", period, "m", {action: tuned}))
    return tuned


def test_an_estimator_file_replaces_what_the_scenario_says(tmp_path):
    path = tmp_path / "tuned.yaml"
    tuned = estimator_file(path)
    scenario = load_scenario("ikea_chair", (f"estimator_file={path}", "estimator.place_rails.fused=true"))
    estimators = load_people(scenario).estimators(scenario)
    rails, screws = estimators[0], estimators[2]
    assert (rails.estimator.reference == tuned.reference).all()
    assert rails.calibration == tuned.calibration
    assert rails.fused
    assert not screws.fused
    assert screws.estimator.gamma == 0.68
    assert estimators[1] is None


def test_an_estimator_file_moves_with_the_recordings(tmp_path):
    """Its positions are in the recorder's frame, as theirs are."""
    tuned = estimator_file(tmp_path / "tuned.yaml")
    path = tmp_path / "hand.npz"
    write_demonstrations(path, [recording("A", "1", 20), recording("B", "1", 23)])
    overrides = (f"estimator_file={tmp_path / 'tuned.yaml'}", f"human.demonstrations={path}")
    moved = load_scenario("ikea_chair", overrides)
    people = load_people(moved)
    np.testing.assert_allclose(people.estimators(moved)[0].estimator.reference, tuned.reference + people.shift)
    for scenario, tracked in ((load_scenario("ikea_chair", (*overrides, "human.workplace=[]")), False), (moved, True)):
        people = load_people(scenario, tracked=tracked)
        np.testing.assert_array_equal(people.estimators(scenario)[0].estimator.reference, tuned.reference)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"action": "fly"}, "holds no action of the task"),
        ({"period": 0.05}, "was tuned for samples every 0.05 s"),
        ({"axes": 2}, "place_rails: has a reference of 2 axes"),
    ],
)
def test_an_estimator_file_that_does_not_fit_is_refused(tmp_path, content, message):
    path = tmp_path / "tuned.yaml"
    estimator_file(path, **content)
    scenario = load_scenario("ikea_chair", (f"estimator_file={path}",))
    with pytest.raises(InputError, match=message):
        load_people(scenario).estimators(scenario)


def test_an_episode_is_one_person_s(chair):
    """Where people have a pace, all demonstrations of an episode are of one subject; without, they are mixed."""
    people = load_people(chair)
    rng = np.random.default_rng(0)

    def subjects(scenario):
        episode = people.sample(scenario, rng)
        return {g[k].subject for g, k in zip(people.demonstrations, episode.demonstration, strict=True) if g}

    assert all(len(subjects(chair)) == 1 for _ in range(30))
    apart = load_scenario("ikea_chair", ("human.pace_correlation=0",))
    assert any(len(subjects(apart)) > 1 for _ in range(30))
    chosen = people.sample(chair, rng, Person("S3", 0.0))
    assert {g[k].subject for g, k in zip(people.demonstrations, chosen.demonstration, strict=True) if g} == {"S3"}


def test_a_group_has_every_subject_and_pace(chair):
    people = load_people(chair)
    group = people.draw_group(10, np.random.default_rng(0))
    assert [person.subject for person in group] == [f"S{k}" for k in (1, 2, 3, 4, 5)] * 2
    assert sorted(person.pace for person in group) == pytest.approx(norm.ppf((np.arange(10) + 0.5) / 10))
    assert group != people.draw_group(10, np.random.default_rng(1))


def test_unseen_people_are_others_compared_with_the_same_references(chair):
    known, unseen = (load_people(load_scenario("ikea_chair", (f"human.split={s}",))) for s in ("train", "unseen"))
    assert "12 unseen people" in unseen.description
    assert len(unseen.subjects) == 12
    for a, b in zip(known.references, unseen.references, strict=True):
        assert (a is None and b is None) or np.array_equal(a.p_WH, b.p_WH)
    for known_group, group in zip(known.training, unseen.training, strict=True):
        assert all(np.array_equal(a.p_WH, b.p_WH) for a, b in zip(known_group, group, strict=True))
    # Neither the known people nor what their seed would give of twelve.
    twelve = generate_demonstrations(seed=0, num_subjects=12)
    hands = {d.p_WH.tobytes() for d in (*(d for group in known.demonstrations for d in group), *twelve.demonstrations)}
    assert not any(d.p_WH.tobytes() in hands for group in unseen.demonstrations for d in group)
    unusual = load_people(load_scenario("ikea_chair", ("human.split=unseen", "human.unseen_variety=3")))
    spread = [np.std([d.duration for d in p.demonstrations[4]]) for p in (unseen, unusual)]
    assert spread[1] > 1.5 * spread[0]


def test_the_ensemble_is_used_where_its_phase_is(chair):
    """Three distances with the reference and a trial of each of five people; the alignment with the reference first."""
    people = load_people(chair)
    plain = people.estimators(chair)[0]
    assert isinstance(plain.estimator, OpenEndSoftDTW)
    assert not plain.fused
    several = people.estimators(load_scenario("ikea_chair", ("observation=history",)))[0]
    assert several.fused
    members = several.estimator.estimators
    assert [one.distance for one in members] == ["wp"] * 6 + ["derivative"] * 6 + ["euclidean"] * 6
    np.testing.assert_array_equal(members[0].reference, plain.estimator.reference)


def test_the_ensemble_is_nearer_to_fast_people(chair):
    """Validation trials in 0.6 of the actions' mean durations, where the paper's alignment lags in one or the other."""
    fused = load_scenario("ikea_chair", ("observation=fused",))
    people = load_people(fused)
    period = fused.human.sample_period
    squares = []
    for k, (paper, several) in enumerate(zip(people.estimators(chair), people.estimators(fused), strict=True)):
        if paper is None:
            continue
        seconds = 0.6 * chair.task.human_actions[k].duration.mean
        times = np.arange(0.0, seconds, period)
        hands = [d.positions(times, seconds) for d in people.demonstrations[k]]
        squares.append(
            [
                np.mean([(z - times / seconds)[len(times) // 2 :] ** 2 for z in one.estimator.phases(hands)])
                for one in (paper, several)
            ]
        )
    error = np.sqrt(np.mean(squares, axis=0))
    assert error[1] < 0.06
    assert error[1] < 0.85 * error[0]


def test_without_training_trials_there_is_no_filter_to_fuse(tmp_path):
    people = people_of(tmp_path, recording("A", "1", 20), recording("B", "1", 22))
    scenario = load_scenario("ikea_chair", ("observation=fused",))
    with pytest.raises(InputError, match="observation: fused"):
        people.estimators(scenario)
