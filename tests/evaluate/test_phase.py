"""The comparison of estimators: who is fitted to what, and how scores are put together."""

import json
import math

import numpy as np
import pytest

from pace_drake.dtw.scores import mean_squared_error
from pace_drake.dtw.tune import EU, OE, WP, Setting, Tuned
from pace_drake.errors import InputError
from pace_drake.evaluate.phase import (
    CONSTANT,
    DERIVATIVE,
    ESTIMATORS,
    FUSED,
    PARTS,
    PROMP,
    TIME,
    evaluate,
    example,
    fit,
    fit_all,
    searches,
)
from tests.evaluate.test_tuning import tiny_signals

TUNED = {
    OE: Tuned(Setting("euclidean", 0.0, 0.3, 0), 0.1, math.nan, 0),
    EU: Tuned(Setting("euclidean", 0.2, 0.3, 2), 0.1, math.nan, 1),
    WP: Tuned(Setting("wp", 0.5, 0.6, 1), 0.1, math.nan, 1),
}


def evaluated(**parts):
    signals = tiny_signals(**parts)
    return evaluate(signals, [fit(action, TUNED) for action in signals.actions])


@pytest.fixture(scope="module")
def evaluation():
    return evaluated()


def test_each_action_has_its_searches_in_order():
    signals = tiny_signals()
    jobs = searches(signals, 5, 7)
    assert [(job.signals.action, job.metrics) for job in jobs] == [
        (action, (metric,)) for action in ("lift", "put down") for metric in (OE, EU, WP)
    ]
    assert {(job.trials, job.seed, job.stretches, job.journal) for job in jobs} == {(5, 7, (1.0,), None)}
    fitted = fit_all(signals, [TUNED[job.metrics[0]] for job in jobs])
    assert [one.action.action for one in fitted] == ["lift", "put down"]
    assert fitted[0].tuned == TUNED


def test_estimators_are_those_of_the_settings_and_of_the_training_signals(evaluation):
    one = evaluation.fitted[0]
    train = [signal.values for signal in one.action.train]
    query = one.action.heldout_people[0].values
    assert tuple(one.estimators) == ESTIMATORS
    for name in (OE, EU, WP):
        expected = TUNED[name].setting.estimator(train, 0.1).phase(query)
        assert (one.estimators[name].phase(query) == expected).all()
    assert one.estimators[TIME].mean_duration == pytest.approx(np.mean([0.1 * (len(p) - 1) for p in train]))
    assert (one.estimators[FUSED].estimator.phase(query) == one.estimators[WP].phase(query)).all()
    assert one.references == {OE: 0, EU: 2, WP: 1, DERIVATIVE: 1, FUSED: 1}


def test_a_score_is_the_mean_over_signals_but_for_the_reference(evaluation):
    for one in evaluation.fitted:
        for name in ESTIMATORS:
            for part in PARTS:
                signals = list(getattr(one.action, part))
                if part == "train" and name not in (CONSTANT, TIME, PROMP):
                    del signals[one.references[name]]
                errors = [mean_squared_error(one.estimators[name].phase(signal.values)) for signal in signals]
                assert evaluation.scores[one.action.action][name][part].mse == pytest.approx(np.mean(errors))


def test_only_the_filter_has_intervals(evaluation):
    for name in ESTIMATORS:
        covered = evaluation.mean(name, "heldout_people").coverage
        assert (0.0 <= covered <= 1.0) if name == FUSED else math.isnan(covered)


def test_the_mean_is_over_actions(evaluation):
    for name in ESTIMATORS:
        of_actions = [evaluation.scores[action][name]["heldout_people"].mse for action in ("lift", "put down")]
        assert evaluation.mean(name, "heldout_people").mse == pytest.approx(np.mean(of_actions))


def test_mse_as_json(evaluation):
    table = evaluation.mse()
    assert list(table) == ["lift", "put down", "mean"]
    for of_action in table.values():
        assert tuple(of_action) == ESTIMATORS
        for parts in of_action.values():
            assert tuple(parts) == PARTS
            assert all(isinstance(value, float) for value in parts.values())
    assert table["mean"][WP]["train"] == pytest.approx(
        (table["lift"][WP]["train"] + table["put down"][WP]["train"]) / 2
    )
    assert json.loads(json.dumps(table, allow_nan=False)) == table


@pytest.mark.parametrize(("empty", "kept"), [("people", "heldout_trials"), ("trials", "heldout_people")])
def test_a_part_without_signals_has_no_scores(empty, kept):
    evaluation = evaluated(**{empty: ()})
    missing = f"heldout_{empty}"
    assert evaluation.part == kept
    assert evaluation.mean(WP, missing) is None
    assert evaluation.mse()["mean"][WP][missing] is evaluation.mse()["lift"][WP][missing] is None
    json.dumps(evaluation.mse(), allow_nan=False)
    assert {row["part"] for row in evaluation.rows()} == {"train", kept}
    signal, _ = example(evaluation.fitted[0])
    assert signal in getattr(evaluation.fitted[0].action, kept)


def test_rows_are_flat_and_complete(evaluation):
    rows = evaluation.rows()
    assert len(rows) == 2 * len(ESTIMATORS) * 3
    assert {tuple(row) for row in rows} == {
        (
            *("action", "estimator", "part", "mse", "mae", "bias", "back_jumps", "coverage"),
            *(f"remaining_time_error_{percent}%" for percent in (25, 50, 75, 90)),
        )
    }
    (row,) = [r for r in rows if (r["action"], r["estimator"], r["part"]) == ("lift", FUSED, "train")]
    one = evaluation.scores["lift"][FUSED]["train"]
    assert (row["mse"], row["remaining_time_error_90%"]) == (one.mse, one.remaining_time_error[3])


def test_updates_take_time_and_leave_the_estimators_as_they_were(evaluation):
    for latency in evaluation.latency.values():
        assert 0.0 < latency.p50 <= latency.p99
    assert all(one.num_samples == 0 for fitted in evaluation.fitted for one in fitted.estimators.values())


def test_the_example_is_held_out(evaluation):
    one = evaluation.fitted[0]
    signal, estimates = example(one)
    assert signal is one.action.heldout_people[0]
    for name in ESTIMATORS:
        assert (estimates[name].phase == one.estimators[name].phase(signal.values)).all()


def test_too_few_training_signals_are_refused_at_once():
    signals = tiny_signals()
    for action in signals.actions:
        object.__setattr__(action, "train", action.train[:2])
    with pytest.raises(InputError, match="needs at least 3 training signals"):
        searches(signals, 1, 0)
