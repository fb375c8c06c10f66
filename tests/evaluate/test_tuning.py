"""Searches of several actions: what goes in, what comes out, and what it is compared with."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pace_drake.demos import ActionSignals, Signal, SignalSet
from pace_drake.dtw.estimator_file import read_estimator_file, write_estimator_file
from pace_drake.dtw.filter import Calibration
from pace_drake.dtw.tune import EU, WP, Setting, Tuned
from pace_drake.errors import InputError
from pace_drake.evaluate.tuning import (
    Job,
    estimator_file,
    fused_estimator,
    left_out_time_score,
    load_signals,
    run_jobs,
)

PERIOD = 0.1  # [s]


def tiny_signal(action, person, trial="T1", synthetic=False):
    """Three waves whose pace and shape depend on the person: (24 to 38, 2)."""
    rng = np.random.default_rng([len(action), person])
    s = np.linspace(0.0, 1.0, 24 + 5 * (person % 4) + int(trial[1:]) - 1) ** (0.8 + 0.1 * (person % 4))
    shape = np.column_stack([np.sin(19.0 * s), np.cos(len(action) * s) + s])
    values = shape + 0.05 * rng.normal(size=shape.shape)
    return Signal(action, f"P{person}", trial, PERIOD, values, synthetic)


def tiny_signals(synthetic=False, **parts):
    """Two actions: 4 people to learn from, a further trial of 2 of them, and 2 other people."""

    def signals(action, people, trial="T1"):
        return [tiny_signal(action, person, trial, synthetic) for person in people]

    return SignalSet(
        "waves & <shapes>",
        "tests",
        "none",
        "m",
        [
            ActionSignals(
                action,
                signals(action, range(4)),
                signals(action, parts.get("trials", (0, 1)), "T2"),
                signals(action, parts.get("people", (5, 6))),
            )
            for action in ("lift", "put down")
        ],
    )


def tiny_tuned(reference=1):
    return Tuned(Setting("wp", 0.5, 0.6, reference), 0.02, math.nan, 7)


def test_jobs_run_in_order_and_report():
    lift, put = tiny_signals().actions
    reports = []
    results = run_jobs(
        [Job(lift, (WP,), 1, 0), Job(put, (EU,), 2, 0)], 1, lambda number, done, best: reports.append((number, done))
    )
    assert [one.num_trials for one in results] == [1, 2]
    assert [one.setting.distance for one in results] == ["wp", "euclidean"]
    assert reports == [(0, 1), (1, 1), (1, 2)]


def test_the_number_of_processes_changes_nothing_and_a_failing_job_ends_all(tmp_path):
    lift, put = tiny_signals().actions
    jobs = [Job(lift, (EU,), 1, 0), Job(put, (EU,), 1, 0)]
    reports = []
    assert run_jobs(jobs, 2, lambda *report: reports.append(report)) == run_jobs(jobs, 1)
    assert sorted(report[:2] for report in reports) == [(0, 1), (1, 1)]
    with pytest.raises(InputError, match="cannot be used as journal"):
        run_jobs([replace(jobs[0], journal=tmp_path / "none" / "journal"), jobs[1]], 2)


def test_too_few_signals_are_refused_before_anything_runs():
    lift = tiny_signals().actions[0]
    few = ActionSignals("lift", lift.train[:2], lift.heldout_trials, ())
    with pytest.raises(InputError, match="action 'lift': needs at least 3 training signals, got 2"):
        Job(few, (WP,), 1, 0)


def test_time_alone_is_scored_with_the_mean_duration_of_the_others():
    lift = tiny_signals().actions[0]
    lengths = [len(one.values) for one in lift.train]
    scores = []
    for k, m in enumerate(lengths):
        mean = np.mean([n - 1 for j, n in enumerate(lengths) if j != k])
        scores.append(np.mean([(min(i / mean, 1.0) - i / (m - 1)) ** 2 for i in range(m)]))
    assert left_out_time_score(lift) == pytest.approx(np.mean(scores))
    assert left_out_time_score(lift, (0.75, 1.0, 1.3)) > left_out_time_score(lift)
    one_person = [replace(one, subject="P", trial=f"T{k}") for k, one in enumerate(lift.train)]
    assert math.isnan(left_out_time_score(ActionSignals("lift", one_person[:3], one_person[3:], ())))


def test_the_filter_is_calibrated_on_all_but_the_reference():
    lift = tiny_signals().actions[0]
    fused = fused_estimator(lift, tiny_tuned(reference=1))
    alignment = Setting("wp", 0.5, 0.6, 1).estimator([one.values for one in lift.train], PERIOD)
    others = [alignment.phase(lift.train[k].values) for k in (0, 2, 3)]
    assert fused.calibration == Calibration.fit(others, (len(lift.train[1].values) - 1) * PERIOD, PERIOD, 4)


def test_the_estimator_file_holds_all_that_is_needed(tmp_path):
    signals = tiny_signals(synthetic=True)
    path = tmp_path / "estimators.yaml"
    write_estimator_file(path, estimator_file(signals, [tiny_tuned(), tiny_tuned(reference=2)]))
    read = read_estimator_file(path)
    assert read.description == signals.description
    assert read.description.startswith("SYNTHETIC")
    assert (read.sample_period, read.units, list(read.actions)) == (PERIOD, "m", ["lift", "put down"])
    action = read.actions["put down"]
    assert action.reference_name == "put down/P2/T1"
    np.testing.assert_allclose(action.goal, np.mean([one.values[-1] for one in signals.actions[1].train], axis=0))
    assert action.score == {"train_mse": 0.02, "trials": 7.0}  # a NaN is left out
    query = signals.actions[1].heldout_people[0].values
    expected = fused_estimator(signals.actions[1], tiny_tuned(reference=2))
    assert (action.fused(PERIOD).phase(query) == expected.phase(query)).all()


def test_signals_by_name(tmp_path):
    assert load_signals("synthetic", 3).source.endswith("(seed=3)")
    with pytest.raises(InputError, match="no such folder"):
        load_signals(str(tmp_path / "none"), 0)
