"""Sweeps: the grid, one task as a plain function, the log, and the runner through Ray with failures injected."""

import json
import os
import signal
import time
from dataclasses import replace
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from pace_drake.errors import InputError
from pace_drake.learning.sweep import ROW_UNITS, SPLITS, Failure, _evaluate, _pool, load_sweep, run_task
from pace_drake.learning.sweep_runner import SweepLog, cluster, run_tasks, write_table
from pace_drake.policies.rules import AlwaysAssist, person_waits

# Not by importing it: Ray reads what keeps it on the loopback when it is imported.
needs_ray = pytest.mark.skipif(
    not (find_spec("ray") and find_spec("pyarrow")),
    reason="extra 'ray' is not installed: pip install 'pace_drake[ray]'",
)
needs_training = pytest.mark.skipif(not find_spec("stable_baselines3"), reason="extra 'train' is not installed")

EUCLIDEAN = {"estimator.place_rails": {"distance": "euclidean", "gamma": 0.01}}
TINY = {"scenarios": ["ikea_chair"], "steps": 4096, "episodes": 50}


def sweep(tmp_path, **content):
    path = tmp_path / "sweep.yaml"
    path.write_text(yaml.safe_dump({**TINY, **content}, sort_keys=False))
    return load_sweep(path)


def tasks(tmp_path, **content):
    made, failures = sweep(tmp_path, **content).tasks()
    assert failures == []
    return made


def test_the_grid_is_the_product(tmp_path):
    made = tasks(
        tmp_path,
        seeds=[3, 1],
        human_idle_weight=[0.5, 2],
        observation=["none", "fused"],
        estimators={
            "wp": {},
            "euclidean": EUCLIDEAN,
            "other": {"human.workplace": [], "estimator.place_rails.gamma": 1e-5},
        },
        overrides=["max_decisions=77"],
    )
    assert len(made) == len({task.key for task in made}) == len({str(task.cell) for task in made}) == 24
    assert str(made[1].cell) == "ikea_chair, estimator wp, observation none, lambda 0.5, seed 1"
    for task in made:
        cell, scenario = task.cell, task.scenario
        assert (task.steps, task.episodes, scenario.max_decisions) == (4096, 50, 77)
        assert scenario.observation == cell.observation
        assert scenario.task.human_idle_weight == cell.human_idle_weight
        rails = scenario.estimator["place_rails"]
        assert rails.distance == ("euclidean" if cell.estimator == "euclidean" else "wp")
        assert rails.gamma == {"wp": 1.65, "euclidean": 0.01, "other": 1e-5}[cell.estimator]
        assert len(scenario.human.workplace) == (0 if cell.estimator == "other" else 3)


def test_what_is_left_out_is_the_scenarios_own(tmp_path, chair):
    (task,) = tasks(tmp_path)
    assert task.scenario == chair
    assert str(task.cell) == "ikea_chair, estimator default, seed 0"


def test_a_key_is_of_the_content(tmp_path):
    """So that a row is never taken for one of another scenario, setting or file of estimators."""
    chart = tmp_path / "chart.scxml"
    (own,) = tasks(tmp_path)
    chart.write_bytes(own.scenario.chart_path().read_bytes())
    variants = [
        {},
        {"seeds": [1]},
        {"steps": 4097},
        {"episodes": 51},
        {"human_idle_weight": [2]},
        {"estimators": {"other": {}}},
        {"overrides": ["human.seed=1"]},
        {"overrides": [f"statechart={chart}"]},
    ]
    keys = [tasks(tmp_path, **variant)[0].key for variant in variants]
    assert len(set(keys)) == len(keys)
    assert keys[0] == own.key == tasks(tmp_path, retries=5, human_idle_weight=[3])[0].key
    chart.write_bytes(chart.read_bytes() + b"<!-- changed -->")
    assert tasks(tmp_path, **variants[-1])[0].key != keys[-1]


def test_a_cell_that_cannot_be_used_concerns_itself_alone(tmp_path):
    made, failures = sweep(
        tmp_path, seeds=[0, 1], estimators={"wp": {}, "bad": {"estimator.place_rails.distance": "manhattan"}}
    ).tasks()
    assert [task.cell.estimator for task in made] == ["wp", "wp"]
    assert [(one.cell.estimator, one.cell.seed) for one in failures] == [("bad", 0), ("bad", 1)]
    assert "estimator.place_rails.distance: must be wp, euclidean or sqeuclidean" in failures[0].reason


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"colour": "red"}, "colour: is no key of a sweep; those are scenarios, seeds"),
        ({"scenarios": "ikea_chair"}, "scenarios: must be a list"),
        ({"scenarios": []}, "scenarios: must not be empty"),
        ({"scenarios": [3]}, "scenarios.0: must be a name or a file, is 3"),
        ({"scenarios": ["sofa"]}, "unknown scenario 'sofa'"),
        ({"scenarios": ["none.yaml"]}, "none.yaml: cannot read the scenario"),
        ({"seeds": [0, -1]}, "seeds.1: must be a whole number >= 0, is -1"),
        ({"seeds": [0, 1, 0]}, "seeds.2: stands there already: 0"),
        ({"seeds": [True]}, "seeds.0: must be a whole number"),
        ({"human_idle_weight": [1, 0]}, "human_idle_weight.1: must be a number > 0, is 0"),
        ({"human_idle_weight": ["much"]}, "human_idle_weight.0: must be a number > 0, is 'much'"),
        ({"human_idle_weight": [float("nan")]}, "human_idle_weight.0: must be a number > 0"),
        ({"observation": ["none", "all"]}, "observation.1: must be one of none, paper, fused, history, is 'all'"),
        ({"estimators": []}, "estimators: must be named sets of overrides"),
        ({"estimators": {"wp": ["gamma=1"]}}, "estimators.wp: must be keys of the scenario and values"),
        ({"overrides": ["nothing"]}, "cannot set 'nothing'"),
        ({"overrides": ["task.colour=red"]}, "colour"),
        ({"overrides": "gamma=1"}, "overrides: must be a list"),
        ({"overrides": ["human.demonstrations=hand.csv"]}, "recordings are all played, none is held out"),
        ({"steps": 0}, "steps: must be a whole number >= 1, is 0"),
        ({"episodes": 1}, "episodes: must be a whole number >= 2, is 1"),
        ({"retries": 1.5}, "retries: must be a whole number >= 0, is 1.5"),
    ],
)
def test_bad_files(tmp_path, content, message):
    with pytest.raises(InputError) as error:
        sweep(tmp_path, **content)
    assert str(error.value).startswith(f"{tmp_path / 'sweep.yaml'}: ")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "cannot read the sweep: No such file"),
        ("seeds: [0]", "scenarios: is missing"),
        ("scenarios: [", "expected"),
        ("- ikea_chair", "keys and values are expected"),
    ],
)
def test_files_that_are_no_sweep(tmp_path, text, message):
    path = tmp_path / "sweep.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=message) as error:
        load_sweep(path)
    assert "\n" not in str(error.value)


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    return tasks(tmp_path_factory.mktemp("one"), seeds=[4], human_idle_weight=[2])[0]


@pytest.fixture(scope="module")
def row(task):
    pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")
    return run_task(task)


def test_a_row(row, task):
    assert list(row) == list(ROW_UNITS)
    assert [row[name] for name in ("scenario", "estimator", "observation")] == ["ikea_chair", "default", "paper"]
    assert [row[name] for name in ("human_idle_weight", "seed", "steps", "episodes")] == [2, 4, 4096, 50]
    for split in SPLITS:
        robot, human = row[f"{split}_robot_idle_total"], row[f"{split}_human_idle_total"]
        assert len(row[f"{split}_robot_idle"]) == len(row[f"{split}_human_idle"]) == 3
        assert robot == pytest.approx(sum(row[f"{split}_robot_idle"]))
        assert human == pytest.approx(sum(row[f"{split}_human_idle"]))
        assert row[f"{split}_cost"] == pytest.approx(robot + 2 * human)
        assert row[f"{split}_cost_low"] < row[f"{split}_cost"] < row[f"{split}_cost_high"]
        assert 3 <= row[f"{split}_decisions"] < 40
        assert row[f"{split}_truncated"] == 0
    assert row["validation_cost"] != row["unseen_cost"]
    assert row["training_time"] > 0
    assert 2e8 < row["peak_memory"] < 4e9


def test_tasks_of_a_scenario_are_evaluated_on_the_same_episodes(tmp_path):
    """Who always assists does not look at phases: same episodes, same idle times, whatever the rest of the grid."""
    made = tasks(tmp_path, seeds=[0, 1], observation=["none", "history"], estimators={"wp": {}, "eu": EUCLIDEAN})
    played = [_evaluate(task.scenario, AlwaysAssist(), "unseen", 50) for task in made[::3]]
    assert len({(task.cell.estimator, task.cell.observation) for task in made[::3]}) == 3
    for one in played[1:]:
        assert np.array_equal(one.robot_idle, played[0].robot_idle)
        assert np.array_equal(one.human_idle, played[0].human_idle)
    dearer = replace(made[0].scenario, task=replace(made[0].scenario.task, human_idle_weight=50.0))
    played_dearer = _evaluate(dearer, AlwaysAssist(), "unseen", 50)
    assert np.array_equal(played_dearer.human_idle, played[0].human_idle)
    assert np.array_equal(played_dearer.cost, played[0].robot_idle.sum(axis=1) + 50 * played[0].human_idle.sum(axis=1))
    other = _evaluate(made[0].scenario, AlwaysAssist(), "validation", 50)
    assert not np.array_equal(other.robot_idle, played[0].robot_idle)


def test_the_people_of_the_evaluation_are_held_out(chair, monkeypatch):
    seen = []
    monkeypatch.setattr("pace_drake.learning.sweep.load_people", lambda held_out: seen.append(held_out.human.split))
    monkeypatch.setattr("pace_drake.learning.sweep.make_pool", lambda *_: None)
    _pool.cache_clear()
    trained = replace(chair, human=replace(chair.human, split="train"))
    for split in SPLITS:
        with pytest.raises(AttributeError):  # of the pool that is none
            _evaluate(trained, AlwaysAssist(), split, 50)
    _pool.cache_clear()
    assert seen == list(SPLITS)
    assert "train" not in SPLITS


@needs_training
def test_a_person_who_waits_is_helped_whatever_the_network_prefers(chair):
    import torch

    from pace_drake.learning.greedy import GreedyPolicy

    class Never(torch.nn.Module):
        def forward(self, observations):
            assert observations.dtype == torch.float32
            return torch.tensor([[1.0, 0.0]]).repeat(len(observations), 1)

    same = torch.nn.Identity()
    network = SimpleNamespace(
        features_extractor=same, mlp_extractor=SimpleNamespace(policy_net=same), action_net=Never()
    )
    policy = GreedyPolicy(SimpleNamespace(policy=network), chair)
    observations = np.column_stack([np.ones(6), np.arange(1.0, 7.0), np.ones(6), np.ones(6)])
    assert policy.decide_all(observations).tolist() == [0, 1, 0, 1, 0, 1]
    assert person_waits(observations, policy._joint).tolist() == [False, True] * 3
    assert _evaluate(chair, policy, "validation", 20).finished.all()


def plain_row(task):
    """A row without training."""
    values = {name: 0.5 for name in ROW_UNITS}
    values |= {name: [1.0, 2.0] for name in ROW_UNITS if name.endswith("_idle")}
    values |= {"scenario": "s", "estimator": "e", "observation": "paper", "seed": task.cell.seed}
    return values | {"steps": 1, "episodes": 2, "peak_memory": 3}


def test_the_log_keeps_rows_and_cuts_off_half_a_line(tmp_path):
    first, second = tasks(tmp_path, seeds=[0, 1])
    path = tmp_path / "rows.jsonl"
    with SweepLog(path) as log:
        log.append(first, plain_row(first))
        assert path.read_bytes().endswith(b"}}\n")  # on the disk at once
        log.append(second, plain_row(second))
    whole = path.read_bytes()
    for cut in (1, 20, len(whole.splitlines()[1]) - 3, len(whole.splitlines()[1])):
        path.write_bytes(whole[:-cut])
        with SweepLog(path) as log:
            assert list(log.rows) == [first.key]
            log.append(second, plain_row(second))
        assert path.read_bytes() == whole
    with SweepLog(path) as log:
        assert log.rows == {task.key: plain_row(task) for task in (first, second)}


def test_an_empty_log_is_not_left(tmp_path):
    with SweepLog(tmp_path / "rows.jsonl"):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", ["hello", "hello\n", '{"time": 3}\n', '{"key": "a", "row": {}}\n[1]\n{"key'])
def test_no_other_file_is_taken_for_a_log(tmp_path, content):
    path = tmp_path / "rows.jsonl"
    path.write_text(content)
    with pytest.raises(InputError, match="no row of a sweep"):
        SweepLog(path)
    assert path.read_text() == content


def test_two_sweeps_do_not_write_the_same_log(tmp_path):
    path = tmp_path / "rows.jsonl"
    with SweepLog(path), pytest.raises(InputError, match="another sweep writes it"):
        SweepLog(path)
    with pytest.raises(InputError, match="cannot write the rows"):
        SweepLog(tmp_path / "none" / "rows.jsonl")


@needs_ray
def test_the_table(tmp_path):
    from pyarrow import parquet

    path = tmp_path / "table.parquet"
    made = tasks(tmp_path, seeds=[5, 6])
    write_table(path, [plain_row(task) for task in made])
    table = parquet.read_table(path)
    assert table.column_names == list(ROW_UNITS)
    assert table.to_pylist() == [plain_row(task) for task in made]
    assert table.schema.field("unseen_cost").metadata == {b"unit": b"s"}
    assert sorted(one.name for one in tmp_path.iterdir()) == ["sweep.yaml", "table.parquet"]


@pytest.fixture(scope="module")
def ray_cluster():
    with cluster(jobs=2):
        yield


def listening_addresses():
    """Hexadecimal local addresses at which this process listens."""
    inodes = set()
    for descriptor in os.scandir("/proc/self/fd"):
        try:
            inodes.add(os.readlink(descriptor.path))
        except OSError:  # the one that lists them
            continue
    found = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            columns = line.split()
            if columns[3] == "0A" and f"socket:[{columns[9]}]" in inodes:
                found.append(columns[1].partition(":")[0])
    return found


@needs_ray
def test_nobody_else_on_the_network_can_reach_the_workers(ray_cluster):
    """Ray runs whatever code it is sent."""
    import ray

    assert ray.util.get_node_ip_address() == "127.0.0.1"
    addresses = listening_addresses()
    assert addresses
    assert all(address.endswith("0100007F") for address in addresses)
    assert os.environ["RAY_USAGE_STATS_ENABLED"] == "0"


def run(made, function, retries=2):
    """Runs tasks with two jobs; returns rows by seed, failures in the order of their report, and seeds as reported."""
    rows, reported = {}, []
    failures = run_tasks(
        made,
        lambda task, row: rows.__setitem__(task.cell.seed, row),
        reported.append,
        run=function,
        jobs=2,
        retries=retries,
    )
    assert failures == reported
    return rows, failures


@needs_ray
def test_what_fails_is_tried_again_and_reported_by_name(tmp_path, ray_cluster):
    made = tasks(tmp_path, seeds=[0, 1, 2, 3, 4])

    def sometimes(task):
        seed = task.cell.seed
        with (tmp_path / f"attempts-{seed}").open("a") as file:
            file.write("x")
        attempts = (tmp_path / f"attempts-{seed}").stat().st_size
        if seed == 1 and attempts == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        if seed == 2 and attempts <= 2:
            raise ValueError("not yet\nmore lines")
        if seed == 3:
            raise ValueError("never\nmore lines")
        if seed == 4:
            raise InputError("cannot be used")
        return {"attempts": attempts}

    rows, failures = run(made, sometimes)
    assert rows == {0: {"attempts": 1}, 1: {"attempts": 2}, 2: {"attempts": 3}}
    assert failures == [Failure(made[4].cell, "InputError: cannot be used"), Failure(made[3].cell, "ValueError: never")]
    assert (tmp_path / "attempts-3").stat().st_size == 3
    assert (tmp_path / "attempts-4").stat().st_size == 1  # it would be the same again


@needs_ray
def test_a_task_that_always_kills_its_worker_is_given_up(tmp_path, ray_cluster):
    made = tasks(tmp_path, seeds=[0, 1])

    def deadly(task):
        if task.cell.seed == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return {}

    rows, (failure,) = run(made, deadly, retries=1)
    assert rows == {1: {}}
    assert failure.cell == made[0].cell
    assert "worker died" in failure.reason
    assert "\n" not in failure.reason


@needs_ray
@needs_training
def test_a_worker_computes_the_same_row_with_one_thread(task, row, ray_cluster):
    def whole(task):
        import torch

        return {**run_task(task), "threads": torch.get_num_threads(), "omp": os.environ["OMP_NUM_THREADS"]}

    rows, failures = run([task], whole)
    assert failures == []
    found = rows[task.cell.seed]
    assert (found.pop("threads"), found.pop("omp")) == (1, "1")
    json.dumps(found, allow_nan=False)
    for name in set(ROW_UNITS) - {"training_time", "peak_memory"}:
        assert found[name] == row[name], name
    assert all(isfinite(value) for value in found.values() if isinstance(value, float))


@needs_ray
def test_an_exception_of_the_driver_stops_the_workers(tmp_path, ray_cluster):
    made = tasks(tmp_path, seeds=[0, 1])

    def slow(task):
        if task.cell.seed == 0:
            return {}
        (tmp_path / "pid").write_text(str(os.getpid()))
        time.sleep(600)

    def interrupted(_task, _row):
        while not (tmp_path / "pid").exists():
            time.sleep(0.02)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_tasks(made, interrupted, run=slow, jobs=2)
    status = Path("/proc", (tmp_path / "pid").read_text(), "stat")
    for _ in range(200):
        try:
            if status.read_text().rpartition(")")[2].split()[0] == "Z":
                return
        except OSError:
            return
        time.sleep(0.05)
    raise AssertionError("the worker goes on")
