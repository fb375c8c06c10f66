"""pace train: the files it leaves, its score, going on after a kill, several seeds, TensorBoard, refusals."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="extra 'train' is not installed")

from pace_drake.cli import train as module
from pace_drake.envs.pool import cached_pool
from pace_drake.evaluate.agreement import play_in_diagram
from pace_drake.learning import evaluator, ppo
from pace_drake.policies.learned import LearnedPolicy
from tests.cli.test_run import pace, refused

#: 10 updates of the real settings.
STEPS = 40_960


@pytest.fixture
def quick(monkeypatch):
    """Few decisions, few episodes."""
    small = replace(ppo.TWIN_SETTINGS, num_envs=32, rollout=16, batch_size=128, epochs=1, hidden=16)
    monkeypatch.setattr(ppo, "TWIN_SETTINGS", small)
    monkeypatch.setattr(evaluator, "EPISODES", 40)
    monkeypatch.setattr(ppo, "POOL_SIZE", 40)
    monkeypatch.setattr(evaluator, "POOL_SIZE", 40)
    monkeypatch.setattr("pace_drake.evaluate.policies.POOL_SIZE", 40)


def train(folder, *arguments):
    return "train", "--out", folder / "policy.onnx", "--steps", 2048, "--episodes", 30, *arguments


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_what_it_leaves(chair, chair_people, quick, tmp_path, capsys):
    assert pace(*train(tmp_path, "--seed", 3, "--evaluate-every", 512)) == 0
    printed = capsys.readouterr().out
    assert names(tmp_path) == ["policy.json", "policy.onnx"]  # no checkpoint any more
    card = json.loads((tmp_path / "policy.json").read_text())
    assert card["seeds"] == {"training": 3, "evaluation": 10_001, "score": 10_002}
    assert card["observation"] == "paper"
    assert len(card["scenario_hash"]) == 64
    assert {"pace_drake", "torch", "onnx", "numpy"} <= set(card["versions"])
    history = card["evaluation"]["history"]
    assert [decisions for decisions, _ in history] == [512, 1024, 1536, 2048]
    assert card["evaluation"]["best"]["cost"] == min(cost for _, cost in history)
    # The score is what the diagram says of the same episodes.
    score = card["score"]
    pool = cached_pool(chair, chair_people, 40, 10_002)
    parts = pool.sample(30, np.random.default_rng(10_002))
    policy = LearnedPolicy(tmp_path / "policy.onnx", chair.task)
    played = play_in_diagram(chair, chair_people, policy, [pool.episode(row) for row in parts])
    assert score["cost"] == pytest.approx(played.cost.mean(), abs=1e-8)
    assert score["robot_idle"] == pytest.approx(played.robot_idle.mean(axis=0), abs=1e-8)
    half = 2.045 * played.cost.std(ddof=1) / np.sqrt(30)  # Student's t, 29 degrees of freedom
    assert np.diff(score["cost_interval"])[0] == pytest.approx(2 * half, rel=1e-3)
    assert score["episodes"] == 30
    assert score["split"] == "validation"
    assert f"{score['cost']:.2f} ± {half:.2f} s" in printed


def test_a_file_that_plays_otherwise_in_the_diagram_is_reported(quick, tmp_path, monkeypatch):
    """The check of the exported file is made, and can fail."""
    from pace_drake.evaluate import agreement

    real = agreement.run_episode

    def another(*arguments):
        one = real(*arguments)
        return replace(one, human_idle=(one.human_idle[0] + 1e-5, *one.human_idle[1:]))

    monkeypatch.setattr(agreement, "run_episode", another)
    from pace_drake.cli.main import main

    with pytest.raises(RuntimeError, match=r"human_idle: .* in the twin, .* in the diagram"):
        main([str(a) for a in train(tmp_path)])


def test_without_a_twin_the_diagram_scores(quick, tmp_path, monkeypatch, capsys):
    settings = replace(ppo.PPOSettings(), num_envs=2, rollout=16, batch_size=32, epochs=1)
    monkeypatch.setattr(ppo, "PPOSettings", lambda: settings)
    options = ("--backend", "diagram", "--steps", 32, "--episodes", 2)
    assert pace(*train(tmp_path, *options, "--set", "human.monitor=detector")) == 0
    card = json.loads((tmp_path / "policy.json").read_text())
    assert card["score"]["episodes"] == 2
    assert card["backend"] == "diagram"
    assert names(tmp_path) == ["policy.json", "policy.onnx"]


class Interrupted:
    """Ctrl-C in training, after so many decisions."""

    def __init__(self, monkeypatch, at, seed=0):
        self.real, self.at, self.seed = ppo.train_ppo, at, seed
        self.patch = monkeypatch.context()

    def __enter__(self):
        def train_ppo(scenario, settings, progress, *more, **options):
            def watched(done):
                progress(done)
                if done >= self.at and settings.seed == self.seed:
                    raise KeyboardInterrupt

            return self.real(scenario, settings, watched, *more, **options)

        self.patch.__enter__().setattr(ppo, "train_ppo", train_ppo)

    def __exit__(self, *error):
        return self.patch.__exit__(*error)


def test_ctrl_c_and_resume(quick, tmp_path, monkeypatch, capsys):
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    whole.mkdir()
    broken.mkdir()
    assert pace(*train(whole)) == 0
    with Interrupted(monkeypatch, 100):
        assert pace(*train(broken)) == 130
    assert capsys.readouterr().err.strip() == "pace: interrupted; nothing was kept yet"
    with Interrupted(monkeypatch, 1500):
        assert pace(*train(broken)) == 130
    file = broken / "policy.checkpoint.npz"
    said = f"pace: interrupted; {file} is kept; the same command with --resume goes on"
    assert capsys.readouterr().err.strip() == said
    assert names(broken) == [file.name]
    assert "its seed is 0, not 1" in refused(capsys, *train(broken, "--seed", 1, "--resume"))
    assert pace(*train(broken, "--resume")) == 0
    assert names(broken) == ["policy.json", "policy.onnx"]
    assert (broken / "policy.onnx").read_bytes() == (whole / "policy.onnx").read_bytes()
    one, other = (json.loads((folder / "policy.json").read_text()) for folder in (whole, broken))
    assert one == other


def test_done_it_stays_done(quick, tmp_path, capsys):
    assert pace(*train(tmp_path)) == 0
    cost = re.search("mean cost .*", capsys.readouterr().out)[0]
    before = {path: (path.read_bytes(), path.stat().st_ino) for path in tmp_path.iterdir()}
    assert pace(*train(tmp_path, "--resume")) == 0
    printed = capsys.readouterr().out
    assert f"{tmp_path / 'policy.onnx'}: is done already\n" in printed
    assert cost in printed
    assert {path: path.read_bytes() for path in before} == {path: content for path, (content, _) in before.items()}
    policy = tmp_path / "policy.onnx"
    assert policy.stat().st_ino == before[policy][1]  # not written again


def test_nothing_is_replaced(quick, tmp_path, monkeypatch, capsys):
    with Interrupted(monkeypatch, 1500):
        assert pace(*train(tmp_path)) == 130
    (kept,) = tmp_path.iterdir()
    content = kept.read_bytes()
    assert f"{kept}: is of a training that was interrupted; --resume goes on" in refused(capsys, *train(tmp_path))
    assert kept.read_bytes() == content
    assert pace(*train(tmp_path, "--resume")) == 0
    for name in ("policy.onnx", "policy.json"):  # the second after the first is removed
        before = {file: file.read_bytes() for file in tmp_path.iterdir()}
        for options in ((), ("--backend", "diagram")):
            error = refused(capsys, *train(tmp_path, *options))
            assert f"{tmp_path / name}: exists; choose another --out, or remove it" in error
        assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before
        (tmp_path / name).unlink()


def test_several_seeds(quick, tmp_path, monkeypatch, capsys):
    """Interrupted in the second of three: the first is not trained again, the others end as without."""
    with Interrupted(monkeypatch, 1500, seed=6):
        assert pace(*train(tmp_path, "--seed", 5, "--seeds", 3)) == 130
    assert names(tmp_path) == ["policy-5.json", "policy-5.onnx", "policy-6.checkpoint.npz"]
    first = (tmp_path / "policy-5.onnx").stat().st_mtime_ns
    capsys.readouterr()
    assert pace(*train(tmp_path, "--seed", 5, "--seeds", 3, "--resume")) == 0
    printed = capsys.readouterr().out
    assert (tmp_path / "policy-5.onnx").stat().st_mtime_ns == first
    cards = {seed: json.loads((tmp_path / f"policy-{seed}.json").read_text()) for seed in (5, 6, 7)}
    for seed, card in cards.items():
        assert card["settings"]["seed"] == card["seeds"]["training"] == seed
        assert card["score"]["episodes"] == 30
        assert f"│ {card['score']['cost']:.2f} ± " in printed
    best = min(cards, key=lambda seed: cards[seed]["score"]["cost"])
    assert f"best: seed {best}\n" in printed
    assert f"policy-{best}.onnx, card" in printed
    (tmp_path / "alone").mkdir()
    assert pace(*train(tmp_path / "alone", "--seed", 7)) == 0
    assert (tmp_path / "alone" / "policy.onnx").read_bytes() == (tmp_path / "policy-7.onnx").read_bytes()


@pytest.mark.parametrize("options", [(), ("--seeds", 2)])
def test_what_other_settings_have_made_is_not_taken_for_done(options, quick, tmp_path, capsys):
    assert pace(*train(tmp_path, *options)) == 0
    before = {file: file.read_bytes() for file in tmp_path.iterdir()}
    error = refused(capsys, *train(tmp_path, *options, "--resume", "--steps", 1024))
    assert ".onnx: is not what this command would make; choose another --out, or remove it" in error
    assert {file: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_patience_ends_early(quick, tmp_path, monkeypatch):
    monkeypatch.setattr(evaluator, "IMPROVEMENT", 0.9)  # nothing is an improvement but the first
    assert pace(*train(tmp_path, "--patience", 2, "--evaluate-every", 512)) == 0
    card = json.loads((tmp_path / "policy.json").read_text())
    assert [decisions for decisions, _ in card["evaluation"]["history"]] == [512, 1024, 1536]
    assert card["decisions"] < 2048


def test_tensorboard(quick, tmp_path, capsys):
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    logs = tmp_path / "logs"
    assert pace(*train(tmp_path, "--tensorboard", logs, "--evaluate-every", 1024)) == 0
    (run,) = logs.iterdir()
    assert run.name == "policy_1"
    log = EventAccumulator(str(run))
    log.Reload()
    assert {"eval/cost", "train/value_loss", "train/policy_gradient_loss"} <= set(log.Tags()["scalars"])
    history = json.loads((tmp_path / "policy.json").read_text())["evaluation"]["history"]
    assert [(e.step, e.value) for e in log.Scalars("eval/cost")] == [(n, pytest.approx(c)) for n, c in history]


def test_without_tensorboard_a_line_says_what_to_install(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    message = refused(capsys, *train(tmp_path, "--tensorboard", tmp_path / "logs"))
    assert "pip install 'pace_drake[train]'" in message
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--backend", "diagram", "--resume"], "--resume: checkpoints and evaluations are of trainings on the twin"),
        (["--backend", "diagram", "--patience", "3"], "--patience"),
        (["--resume"], "no such checkpoint to go on from"),
        (["--out", "policy.zip"], "must end in .onnx"),
        (["--out", "{folder}/none/policy.onnx"], "no such folder"),
        (["--seeds", "0"], "--seeds"),
        (["--set", "human.monitor=button"], "the twin knows the person as told"),
    ],
)
def test_refusals(tmp_path, capsys, arguments, message):
    given = [one.format(folder=tmp_path) for one in arguments]
    assert message in refused(capsys, *train(tmp_path), *given)
    assert names(tmp_path) == []


@pytest.mark.slow
def test_a_killed_training_goes_on(tmp_path):
    """SIGKILL, in another process; the policy is the same file, byte by byte."""
    command = [sys.executable, "-m", "pace_drake.cli.main", "train", "--steps", str(STEPS), "--episodes", "20"]
    command += ["--out", str(tmp_path / "policy.onnx")]
    killed = subprocess.Popen(command, env=os.environ, stdout=subprocess.DEVNULL)
    file, until = tmp_path / "policy.checkpoint.npz", time.monotonic() + 120
    while not file.exists() and killed.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    killed.send_signal(signal.SIGKILL)
    assert killed.wait() == -signal.SIGKILL
    assert not (tmp_path / "policy.onnx").exists()
    (tmp_path / ".policy.checkpoint.1.part.npz").touch()  # as if it had been killed while it wrote
    assert pace(*command[3:], "--resume") == 0
    assert names(tmp_path) == ["policy.json", "policy.onnx"]
    assert pace(*command[3:-1], tmp_path / "whole.onnx") == 0
    assert (tmp_path / "whole.onnx").read_bytes() == (tmp_path / "policy.onnx").read_bytes()


def test_scores_are_of_episodes_that_were_not_trained_or_chosen_on():
    assert len({module.SCORE_SEED, evaluator.EVALUATION_SEED}) == 2
