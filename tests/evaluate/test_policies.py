"""pace_drake.evaluate.policies, and pace evaluate policy."""

import json

import numpy as np
import pytest

from pace_drake.cli.main import main
from pace_drake.diagram import Assembly
from pace_drake.envs.pool import make_pool
from pace_drake.evaluate.episode import run_episode
from pace_drake.evaluate.policies import POOL_SIZE, evaluate_policies
from pace_drake.people import load_people
from pace_drake.policies.factory import make_policy
from pace_drake.simulation import Simulation

NAMES = ("explicit_query", "elapsed_threshold", "phase_threshold", "learned")


def test_it_is_what_the_diagram_says_of_the_same_episodes(chair):
    people = load_people(chair)
    results, limit = evaluate_policies(chair, people, {n: make_policy(n, chair) for n in NAMES}, 12, seed=4)
    assert 0 < limit < min(result.cost for result in results)
    rng = np.random.default_rng(4)
    pool = make_pool(chair, people, POOL_SIZE, rng)
    parts = pool.sample(12, rng)
    for name, result in zip(NAMES, results, strict=True):
        simulation = Simulation(Assembly(chair, make_policy(name, chair)))
        played = [run_episode(simulation, pool.episode(row)) for row in parts]
        assert result.cost == pytest.approx(np.mean([one.cost for one in played]), abs=1e-8)
        assert result.robot_idle == pytest.approx(np.mean([one.robot_idle for one in played], axis=0), abs=1e-8)
        assert result.human_idle == pytest.approx(np.mean([one.human_idle for one in played], axis=0), abs=1e-8)
        assert result.decisions == pytest.approx(np.mean([one.decisions for one in played]))
        assert result.truncated == 0


def test_intervals_cover_and_savings_are_paired(chair):
    people = load_people(chair)
    policies = {n: make_policy(n, chair) for n in NAMES}
    few = [evaluate_policies(chair, people, policies, 200, seed)[0][1] for seed in range(6)]
    truth = evaluate_policies(chair, people, policies, 4000, 99)[0][1]
    covered = [one.cost_interval[0] <= truth.cost <= one.cost_interval[1] for one in few]
    assert sum(covered) >= 4
    # Paired: the episodes are the same, so the saving is known better than two costs that were drawn apart.
    apart = np.hypot(*(np.diff(one.cost_interval)[0] for one in few[:2]))
    assert np.diff(few[0].saving_interval)[0] < 1.2 * apart
    assert few[0].saving > 50


def test_never_assisting_is_cut_off(chair):
    (result,), _ = evaluate_policies(chair, load_people(chair), {"never": make_policy("never_assist", chair)}, 3, 0)
    assert result.truncated == 1.0
    assert result.decisions == chair.max_decisions


def test_the_command(tmp_path, capsys):
    out = tmp_path / "figures.json"
    with pytest.raises(SystemExit) as stopped:
        main(
            [
                "evaluate",
                "policy",
                "--episodes",
                "50",
                "--policy",
                "explicit_query",
                "--policy",
                "learned",
                "--json",
                str(out),
            ]
        )
    assert stopped.value.code == 0
    text = capsys.readouterr().out
    assert "SYNTHETIC" in text
    assert "validation trials" in text
    data = json.loads(out.read_text())
    for split in ("train", "validation", "unseen"):
        rows = data["splits"][split]
        assert list(rows) == ["explicit query", "learned", "optimum without phase", "perfect phase", "clairvoyant"]
        assert 0 < rows["clairvoyant"]["cost"] < rows["perfect phase"]["cost"] < rows["learned"]["cost"]
        assert rows["learned"]["saving"] == pytest.approx(rows["explicit query"]["cost"] - rows["learned"]["cost"])
        assert rows["learned"]["worlds"] == 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "magic"], "unknown policy 'magic'"),
        (["--json", "absent/x.json"], "absent: no such folder"),
        (["--set", "human.monitor=detector"], "use the diagram"),
        (["absent"], "absent"),
    ],
)
def test_mistakes_give_one_line(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        main(["evaluate", "policy", "--episodes", "2", *arguments])
    assert stopped.value.code == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
