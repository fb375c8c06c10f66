"""Worlds of people, the table over them, and the reports."""

import csv
import json
from functools import partial

import numpy as np
import pytest

from pace_drake.cli.main import main
from pace_drake.cli.tables import rich_table, wide_console
from pace_drake.envs.pool import make_pool
from pace_drake.errors import InputError
from pace_drake.evaluate import worlds
from pace_drake.evaluate.play import play
from pace_drake.evaluate.policy_report import Comparison, studies, tables, to_json, write_report
from pace_drake.evaluate.policy_table import rows_of
from pace_drake.evaluate.sensitivity import evaluate_cases, lambda_cases, other_cases
from pace_drake.evaluate.sensitivity_report import Sensitivity
from pace_drake.evaluate.sensitivity_report import tables as sensitivity_tables
from pace_drake.evaluate.sensitivity_report import write_report as write_sensitivity
from pace_drake.evaluate.worlds import (
    CLAIRVOYANT,
    FITTED,
    NO_PHASE,
    PERFECT,
    Sizes,
    WorldTask,
    evaluate_world,
    evaluate_worlds,
    ppo_name,
    with_phase_error,
)
from pace_drake.people import load_people
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario

EPISODES = 300


@pytest.fixture(scope="module")
def plain():
    """Without averaged alignments: fast."""
    names = ("place_rails", "place_screws", "tighten_screws")
    return load_scenario("ikea_chair", tuple(f"estimator.{name}.ensemble=false" for name in names))


def stand_in(scenario, seed):
    """For PPO: the thresholds that come with the scenario."""
    return make_policy("elapsed_threshold" if scenario.observation == "none" else "phase_threshold", scenario)


#: Little: what is tested is not how good the policies are.
SMALL = Sizes(training_draws=256, draws=240, search_episodes=300, fit_episodes=3000)


def world_task(scenario, seed, **changes):
    return WorldTask(scenario, seed, EPISODES, stand_in, ("none", "paper", "history"), sizes=SMALL, **changes)


@pytest.fixture(scope="module")
def results(plain):
    return [evaluate_world(world_task(plain, seed)) for seed in (0, 1)]


def test_the_order_of_the_table(results):
    """Bounds below policies below those that know less, in both worlds and with all people."""
    for result in results:
        for split, played in result.played.items():
            cost = {name: one.cost.mean() for name, one in played.items()}
            assert result.clairvoyant[split].mean() < cost[PERFECT] < cost[FITTED] < cost[NO_PHASE]
            assert cost[NO_PHASE] < cost["always assist"] < cost["explicit query"] < cost["never assist"]
            assert not played["never assist"].finished.any()
            assert all(len(one.cost) == EPISODES for one in played.values())
            assert 0.02 < result.phase_rmse[split] < 0.15


def test_unseen_people_are_twelve_others(results, plain):
    assert set(results[0].person["unseen"]) == set(range(12))
    assert (results[0].clairvoyant["unseen"] != results[0].clairvoyant["train"]).any()
    again = evaluate_world(world_task(plain, 0, splits=("unseen",)))
    for name, one in again.played["unseen"].items():
        np.testing.assert_array_equal(one.cost, results[0].played["unseen"][name].cost)


def test_rows(results):
    rows = {row.policy: row for row in rows_of(results, "unseen")}
    for name, row in rows.items():
        if name == CLAIRVOYANT:
            continue
        means = [r.played["unseen"][name].cost.mean() for r in results]
        assert row.cost == pytest.approx(np.mean(means))
        # 95 % of Student's t with one degree of freedom.
        assert row.cost_interval[1] - row.cost == pytest.approx(12.7062 * np.std(means, ddof=1) / np.sqrt(2), rel=1e-4)
        assert row.robot_idle_total == pytest.approx(sum(row.robot_idle))
        assert row.cost == pytest.approx(row.robot_idle_total + 3 * row.human_idle_total, rel=1e-6)
        assert row.concurrent_share + row.delay_share == pytest.approx(100)
    assert rows[NO_PHASE].cheaper == 0
    first = [r.played["unseen"]["explicit query"].cost.mean() for r in results]
    assert rows[NO_PHASE].saving == pytest.approx(np.mean(first) - rows[NO_PHASE].cost)
    assert rows["explicit query"].saving_interval == (0, 0)
    assert rows[PERFECT].gap == pytest.approx(100)
    none = [r.played["unseen"][NO_PHASE].cost.mean() for r in results]
    paper = [r.played["unseen"][ppo_name("paper")].cost.mean() for r in results]
    saved = [100 * (1 - p / n) for p, n in zip(paper, none, strict=True)]
    assert rows[ppo_name("paper")].cheaper == pytest.approx(np.mean(saved))
    assert rows[ppo_name("paper")].cheaper_range == pytest.approx((min(saved), max(saved)))
    query = rows["explicit query"]
    assert query.robot_idle_total == 0
    assert query.robot_task_rate > rows["always assist"].robot_task_rate == 0


@pytest.fixture(scope="module")
def comparison(results):
    return Comparison("chair", "SYNTHETIC people", True, results, 0, (0.25,))


def test_report(comparison, tmp_path):
    write_report(tmp_path, comparison, *studies(comparison), "pace evaluate policy <chair>")
    page = (tmp_path / "index.html").read_text()
    for text in (
        "SYNTHETIC",
        "PACE without phase (paper)",
        "28.29",
        "pace evaluate policy &lt;chair&gt;",
        "Wilcoxon",
        "Power",
    ):
        assert text in page
    assert page.count("data:image/png;base64,") == 2
    rows = list(csv.DictReader((tmp_path / "policies.csv").open()))
    assert {row["split"] for row in rows} == {"train", "validation", "unseen"}
    assert len(rows) == 3 * (len(comparison.results[0].played["unseen"]) + 1)
    assert all(
        float(row["cost_interval_low"]) <= float(row["cost"]) <= float(row["cost_interval_high"]) for row in rows
    )


def test_json_has_every_policy_in_every_split(comparison):
    data = json.loads(json.dumps(to_json(comparison, *studies(comparison)), allow_nan=False))
    for split in ("train", "validation", "unseen"):
        row = data["splits"][split][ppo_name("paper")]
        assert len(row["robot_idle"]) == len(row["human_idle"]) == 3
        assert row["cost_interval"][0] < row["cost"] < row["cost_interval"][1]
    assert data["splits"]["unseen"][CLAIRVOYANT]["robot_idle_total"] is None
    assert data["study"]["participants"] == 12
    assert [power["sizes"] for power in data["power"]] == [[12, 24, 36]] * 2
    assert data["paper"]["PACE"] == {
        "robot_idle": [1.93, 2.65, 1.28],
        "human_idle": [1.20, 0.56, 2.56],
        "cost": 18.81,
        "note": "the paper, other people and other data",
    }


def test_tables_say_synthetic_and_whose_the_paper_s_rows_are(comparison):
    found = tables(comparison, *studies(comparison))
    assert all("SYNTHETIC" in table.title for table in found)
    assert [row[0] for row in found[0].rows][-1] == "PACE (paper)"
    assert found[0].title.endswith("; (paper): other people and other data")
    assert all(len(row) == len(table.columns) for table in found for row in table.rows)


def test_tables_are_no_wider_than_a_terminal(comparison, capsys):
    """Piped, where rich takes any width; the widest name of ours is in them."""
    console = wide_console()
    for table in tables(comparison, *studies(comparison)):
        console.print(rich_table(table))
    printed = capsys.readouterr().out
    assert max(len(line.rstrip()) for line in printed.splitlines()) < 100
    assert "remaining time threshold" in printed
    assert "…" not in printed


def test_recordings_cannot_be_redrawn(plain, tmp_path):
    recorded = load_scenario("ikea_chair", ("human.demonstrations=absent.csv",))
    with pytest.raises(InputError, match="redrawn, which recordings cannot be"):
        evaluate_world(WorldTask(recorded, 0, 10))


def test_phase_errors_are_offsets_within_bounds(plain):
    pool = make_pool(plain, load_people(plain), 16, np.random.default_rng(0))
    worse = with_phase_error(pool, 0.1, np.random.default_rng(1))
    assert with_phase_error(pool, 0.0, np.random.default_rng(1)) is pool
    for j in range(6):
        for start, length in zip(pool.phases.start[j], pool.phases.length[j], strict=True):
            part = slice(start, start + length)
            before, after = pool.phases.values[part, 0], worse.phases.values[part, 0]
            if j % 2:
                assert (before == after).all()
                continue
            free = (after > 0) & (after < 1)
            assert (after >= 0).all()
            assert (after <= 1).all()
            assert np.ptp((after - before)[free]) < 1e-9
    assert (worse.phases.values[:, 3] == pool.phases.values[:, 3])[~np.isnan(pool.phases.values[:, 3])].all()


def test_sensitivity(plain, tmp_path):
    lambdas = [case for case in lambda_cases() if case.value in (1.0, 10.0)]
    others = [
        case for case in other_cases(plain) if case.label in ("as it is", "human cv 0.10", "phase offset 0.15 rms more")
    ]
    found = evaluate_cases(plain, [*lambdas, *others], (0,), 200, stand_in, sizes=SMALL)
    of = {result.case.label: result for result in found}
    assert of["lambda 10"].row(NO_PHASE).human_idle_total < of["lambda 1"].row(NO_PHASE).human_idle_total
    assert of["human cv 0.10"].row(NO_PHASE).cost < of["as it is"].row(NO_PHASE).cost
    assert of["phase offset 0.15 rms more"].row(FITTED).cost > of["as it is"].row(FITTED).cost
    assert of["phase offset 0.15 rms more"].row(NO_PHASE).cost == of["as it is"].row(NO_PHASE).cost
    sensitivity = Sensitivity("chair", found[:2], found[2:])
    assert all("SYNTHETIC" in table.title for table in sensitivity_tables(sensitivity))
    write_sensitivity(tmp_path, sensitivity, "pace evaluate sensitivity")
    assert (tmp_path / "index.html").read_text().count("data:image/png;base64,") == 2
    assert len(list(csv.DictReader((tmp_path / "sensitivity.csv").open()))) == 6 * len(found)


def test_every_case_can_be_made(plain):
    for case in (*lambda_cases(), *other_cases(plain)):
        assert (
            case.scenario(plain).to_yaml() != plain.to_yaml()
            or case.label in ("as it is", "lambda 3")
            or case.phase_error
        )
    assert plain == load_scenario("ikea_chair", tuple(f"estimator.{n}.ensemble=false" for n in plain.estimator))


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as stopped:
        main(["evaluate", *arguments])
    return stopped.value.code, capsys.readouterr()


def test_the_command_with_worlds(tmp_path, capsys, monkeypatch):
    pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")
    monkeypatch.chdir(tmp_path)
    names = ("place_rails", "place_screws", "tighten_screws")
    plain = [part for name in names for part in ("--set", f"estimator.{name}.ensemble=false")]
    short = ["--worlds", "1", "--episodes", "50", "--steps", "4096", *plain]
    code, printed = run(capsys, "policy", *short, "--json", "x.json", "--out", "report")
    assert code == 0, printed.err
    assert "PPO, history" in printed.out
    assert set(json.loads((tmp_path / "x.json").read_text())["splits"]) == {"train", "validation", "unseen"}
    assert (tmp_path / "report" / "index.html").is_file()
    code, printed = run(capsys, "policy", "--out", "report")
    assert (code, printed.err.count("\n")) == (2, 1)
    assert "exists and is not empty" in printed.err
    code, printed = run(capsys, "policy", "--steps", "5")
    assert code == 2
    assert "--steps: policies are trained with --worlds only" in printed.err


def test_players_are_what_they_say(results, plain):
    """The row of a threshold is what the threshold does on the same episodes."""
    unseen = worlds.in_world(plain, 0, "unseen")
    twin, parts = worlds._twin_of(unseen, EPISODES, np.random.default_rng([0, 2]), SMALL.draws)
    played = partial(play, twin, parts)(make_policy("phase_threshold", plain))
    np.testing.assert_array_equal(played.cost, results[0].played["unseen"][ppo_name("paper")].cost)


def test_processes_change_nothing(plain, results):
    tasks = [world_task(plain, seed, splits=("validation",)) for seed in (0, 1)]
    seen = []
    for result, alone in zip(evaluate_worlds(tasks, 2, seen.append), results, strict=True):
        for name, played in result.played["validation"].items():
            np.testing.assert_array_equal(played.cost, alone.played["validation"][name].cost)
    assert seen == [1, 2]
