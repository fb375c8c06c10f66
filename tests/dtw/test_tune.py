"""Tuning: its score is what it says it is, a search goes on where it was, and a journal is of one search alone."""

import json
import math
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.dtw.scores import linear_phase, mean_squared_error
from pace_drake.dtw.tune import EU, OE, WP, _Search, stretched, tune
from pace_drake.errors import InputError

PERIOD = 0.1  # [s]


def path(person, length):
    """Three waves whose pace and shape depend on the person: (length, 2)."""
    rng = np.random.default_rng(person)
    s = linear_phase(length) ** (0.8 + 0.1 * person)
    shape = np.column_stack([np.sin(19.0 * s), np.cos(11.0 * s) + s])
    return shape + 0.05 * rng.normal(size=shape.shape)


PATHS = [path(k, length) for k, length in enumerate((30, 36, 26, 33))]
PEOPLE = ["A", "B", "C", "D"]
SEARCH = _Search(PATHS, PEOPLE, PERIOD, (1.0,))


def mse(distance, gamma, window, reference, query):
    estimator = OpenEndSoftDTW(reference, gamma, distance, window, sample_period=PERIOD)
    return float(np.mean((estimator.phase(query) - np.linspace(0, 1, len(query))) ** 2))


def tuned(paths=PATHS, people=PEOPLE, **changes):
    return tune(paths, people, PERIOD, **({"trials": 4} | changes))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A search that was not interrupted, and its journal."""
    journal = tmp_path_factory.mktemp("whole") / "journal.jsonl"
    return tuned(journal=journal), journal


# --- what is found ---


def test_the_score_is_the_mean_over_the_people_other_than_the_references(whole):
    found, _ = whole
    s = found.setting
    others = [k for k in range(4) if k != s.reference]
    errors = [mse(s.distance, s.gamma, s.window, PATHS[s.reference], PATHS[k]) for k in others]
    assert found.score == pytest.approx(np.mean(errors), rel=1e-12)
    assert found.num_trials == 4


@settings(max_examples=30, deadline=None)
@given(st.floats(-3.25, 0.75), st.floats(0.3, 3.0))
def test_settings_are_figures_that_people_can_read(log_gamma, window):
    one = SEARCH._setting(WP, 2.0, log_gamma, window, 1)
    assert one.gamma == float(f"{one.gamma:.3g}")
    assert one.gamma == (0.0 if log_gamma < -3.0 else pytest.approx(2.0 * 10.0**log_gamma, rel=0.01))
    assert one.window == float(f"{one.window:.1f}")  # whole samples
    assert one.window == pytest.approx(window, abs=0.5 * PERIOD + 1e-9)
    assert one.estimator(PATHS, PERIOD).window == one.window


def test_windows_have_two_samples_at_least():
    assert _Search(PATHS, PEOPLE, 1.0, (1.0,))._setting(WP, 1.0, 0.0, 0.3, 0).window == 2.0


def test_candidates_are_ranked_by_their_best_probe():
    search = _Search(PATHS, PEOPLE, PERIOD, (1.0,))
    ranked = search.probe(EU)
    best = [min(np.nanmean(e) for one, e in search._errors.items() if one.reference == r) for r in ranked]
    assert sorted(ranked) == [0, 1, 2, 3]
    assert best == sorted(best)


def test_optuna_is_quiet_and_linear_algebra_has_one_thread_during_a_search_only():
    import optuna
    from threadpoolctl import threadpool_info, threadpool_limits

    def state():
        return optuna.logging.get_verbosity(), {pool["num_threads"] for pool in threadpool_info()}

    states = []
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.INFO)
    with threadpool_limits(2):
        tuned(metrics=(EU,), trials=1, on_trial=lambda *_: states.append(state()))
        states.append(state())
    optuna.logging.set_verbosity(before)
    assert states == [(optuna.logging.ERROR, {1}), (optuna.logging.INFO, {2})]


def test_trials_in_the_journal_are_within_the_ranges_and_shared_among_the_metrics(whole):
    found, journal = whole
    rows = [json.loads(line) for line in journal.read_text().splitlines()][1:]
    assert [(row["metric"], row["number"]) for row in rows] == [(WP, 0), (WP, 1), (EU, 0), (EU, 1)]
    for row in rows:
        assert -3.25 <= row["params"]["log_gamma"] <= 0.75
        assert ("window" in row["params"]) == (row["metric"] == WP)  # a Euclidean distance has none
        assert [error is None for error in row["errors"]] == [k == row["params"]["reference"] for k in range(4)]
        assert found.score <= np.mean([error for error in row["errors"] if error is not None])


def test_best_of_the_metrics_is_taken(whole):
    alone = [tuned(metrics=(metric,), trials=2) for metric in (WP, EU)]
    assert whole[0].score == min(one.score for one in alone)
    assert {one.setting.distance for one in alone} == {"wp", "euclidean"}


def test_oe_dtw_has_the_best_reference_and_takes_no_trials():
    found = tuned(metrics=(OE,))
    scores = [np.mean([mse("euclidean", 0.0, 1.0, PATHS[r], PATHS[k]) for k in range(4) if k != r]) for r in range(4)]
    assert (found.setting.reference, found.num_trials) == (int(np.argmin(scores)), 0)
    assert found.score == pytest.approx(min(scores))
    assert (found.setting.gamma, found.setting.distance) == (0.0, "euclidean")


def test_left_out_people_are_scored_with_what_is_best_for_the_others():
    people = ["A", "B", "C", "A"]
    table = [[mse("euclidean", 0.0, 1.0, PATHS[r], PATHS[k]) for k in range(4)] for r in range(4)]
    scores = []
    for person in "ABC":
        theirs = [k for k in range(4) if people[k] == person]
        usable = [r for r in range(4) if r not in theirs]

        def of_others(r, theirs=theirs):
            return np.mean([table[r][k] for k in range(4) if k not in theirs and people[k] != people[r]])

        best = min(usable, key=of_others)
        scores.append(np.mean([table[best][k] for k in theirs]))
    assert tuned(people=people, metrics=(OE,)).left_out_score == pytest.approx(np.mean(scores))


def test_with_two_people_nobody_can_be_left_out_and_one_person_may_have_all():
    two = tuned(people=["A", "A", "B", "B"], metrics=(OE,))
    assert math.isnan(two.left_out_score)
    assert two.score > 0.0
    one = tuned(people=["A"] * 4, metrics=(OE,))
    assert math.isnan(one.left_out_score)
    assert one.setting == tuned(metrics=(OE,)).setting  # as if each were of a person of its own


def test_the_unit_of_the_samples_does_not_matter():
    factor = 1024.0
    found, scaled = (tuned([c * p for p in PATHS], metrics=(EU,), trials=2) for c in (1.0, factor))
    assert scaled.setting.reference == found.setting.reference
    assert scaled.setting.gamma == pytest.approx(factor * found.setting.gamma, rel=0.01)
    assert scaled.score == pytest.approx(found.score, rel=0.1)


def test_scores_of_stretched_copies_are_averaged():
    found = tuned(metrics=(OE,), stretches=(0.5, 1.0, 2.0))
    r = found.setting.reference
    errors = [
        mse("euclidean", 0.0, 1.0, PATHS[r], stretched(PATHS[k], factor))
        for k in range(4)
        for factor in (0.5, 1.0, 2.0)
        if k != r
    ]
    assert found.score == pytest.approx(np.mean(errors))


def test_stretching():
    assert stretched(PATHS[0], 1.0) is PATHS[0]
    for factor in (0.5, 2.0):
        long = stretched(PATHS[0], factor)
        assert long.shape == (round(29 * factor) + 1, 2)
        assert (long[[0, -1]] == PATHS[0][[0, -1]]).all()
    np.testing.assert_allclose(stretched(PATHS[0], 2.0)[::2], PATHS[0], atol=1e-12)
    assert mean_squared_error(linear_phase(7)) == 0.0


# --- the same search again ---


def test_same_seed_same_result_and_another_seed_other_trials(whole, tmp_path):
    found, journal = whole
    for seed, equal in ((0, True), (1, False)):
        again = tmp_path / f"{seed}.jsonl"
        assert (tuned(seed=seed, journal=again) == found) or not equal
        rows, expected = (file.read_text().splitlines()[1:] for file in (again, journal))
        assert (rows == expected) == equal


def test_an_interrupted_search_goes_on_to_the_same_result(whole, tmp_path):
    found, whole_journal = whole
    journal = tmp_path / "journal.jsonl"

    def interrupt(done, best):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tuned(journal=journal, on_trial=interrupt)
    assert len(journal.read_text().splitlines()) == 1 + 3
    with journal.open("a") as file:
        file.write('{"metric": "OS-DT')  # killed while it wrote
    reports = []
    assert tuned(journal=journal, on_trial=lambda *report: reports.append(report)) == found
    assert journal.read_bytes() == whole_journal.read_bytes()
    assert [done for done, _ in reports] == [1, 2, 3, 4]
    assert [best for _, best in reports] == sorted((best for _, best in reports), reverse=True)


def test_trials_of_the_journal_are_not_done_again(whole, monkeypatch):
    import optuna

    found, journal = whole
    before = journal.read_bytes()
    monkeypatch.setattr(optuna.samplers, "GPSampler", lambda **_: pytest.fail("asked for a trial"))
    assert tuned(journal=journal) == found
    assert journal.read_bytes() == before


def test_more_trials_go_on_from_the_journal(whole, tmp_path):
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(whole[1].read_bytes())
    assert tuned(journal=journal, trials=5).num_trials == 5
    assert len(journal.read_text().splitlines()) == 1 + 5


@pytest.mark.parametrize(
    "changes",
    [
        {"paths": [p + 1e-9 for p in PATHS]},
        {"people": ["A", "B", "C", "C"]},
        {"seed": 1},
        {"stretches": (1.0, 1.3)},
    ],
)
def test_a_journal_of_another_search_is_refused(whole, changes):
    before = whole[1].read_bytes()
    with pytest.raises(InputError, match=r"journal\.jsonl: belongs to another search"):
        tuned(journal=whole[1], **changes)
    assert whole[1].read_bytes() == before


@pytest.mark.parametrize("text", ["some text\n", '{"search": 1}\n{"no": "trial"}\n', "[]\n3\n"])
def test_another_file_is_no_journal(tmp_path, text):
    journal = tmp_path / "notes.txt"
    journal.write_text(text)
    with pytest.raises(InputError, match=r"notes\.txt: (is no journal|belongs to another search)"):
        tuned(journal=journal)
    assert journal.read_text() == text


def test_a_journal_that_cannot_be_written(tmp_path):
    with pytest.raises(InputError, match="cannot be used as journal: No such file or directory"):
        tuned(journal=tmp_path / "none" / "journal.jsonl")


# --- bad input ---


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"paths": PATHS[:1], "people": ["A"]}, "demonstrations must be at least 2, each with its person, got 1"),
        ({"people": ["A"]}, "demonstrations must be at least 2, each with its person"),
        ({"paths": [*PATHS[:3], PATHS[3][:, :1]]}, r"demonstrations\[3\] must be an \(m, 2\) array"),
        ({"paths": [*PATHS[:3], PATHS[3] * np.nan]}, r"demonstrations\[3\] has the value nan"),
        ({"metrics": ("manhattan",)}, "metrics: must be among OS-DTW_WP, OS-DTW_EU, OE-DTW, got 'manhattan'"),
    ],
)
def test_bad_input_is_named(changes, message):
    with pytest.raises(InputError, match=message):
        tuned(**changes)


@pytest.mark.parametrize("package", ["optuna", "torch"])
def test_a_missing_package_is_named(monkeypatch, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"tuning needs {package}: install it with pip install 'pace_drake\[tune\]'"):
        tuned()
    assert tuned(metrics=(OE,)).num_trials == 0  # which needs neither
