"""``pace train``: learns when to assist."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from pace_drake.cli.options import set_option

if TYPE_CHECKING:
    from rich.console import Console
    from stable_baselines3 import PPO

    from pace_drake.evaluate.policies import PolicyResult
    from pace_drake.learning.ppo import PPOSettings
    from pace_drake.people import People
    from pace_drake.scenario import Scenario

#: Seed of the episodes of the final score and of their pool: the same for every training, other than in training.
SCORE_SEED = 10_002
#: Episodes of the final score on the twin, and through the diagram where the twin cannot be used.
EPISODES, DIAGRAM_EPISODES = 2000, 100
#: Episodes that the exported file is also played on in the diagram, which must come out as in the twin.
CHECKED = 5


@click.command("train", short_help="Train a policy with PPO.")
@click.argument("scenario", default="ikea_chair")
@click.option(
    "--backend",
    type=click.Choice(["twin", "diagram"]),
    default="twin",
    show_default=True,
    help="Train on the compiled twin, or step the Drake diagram itself.",
)
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    help="Decisions to train on; default 300,000 with the twin, 20,000 with the diagram.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of everything random.")
@click.option(
    "--seeds", type=click.IntRange(min=1), default=1, show_default=True, help="Train so many: SEED, SEED + 1, ..."
)
@click.option(
    "--resume",
    is_flag=True,
    help="Go on with a training that was interrupted, as if it had not been; one that is done stays as it is.",
)
@click.option(
    "--evaluate-every",
    type=click.IntRange(min=1),
    metavar="DECISIONS",
    help="Evaluate in the course of training, twin only; default every tenth of it. The best network is kept.",
)
@click.option(
    "--patience",
    type=click.IntRange(min=1),
    metavar="N",
    help="Stop after N evaluations without an improvement of 0.5 %; default: never.",
)
@click.option(
    "--tensorboard", type=click.Path(path_type=Path, file_okay=False), metavar="DIR", help="Log for TensorBoard."
)
@click.option(
    "--episodes",
    type=click.IntRange(min=2),
    help="Episodes of the final evaluation; default 2,000, or 100 where the twin cannot be used.",
)
@set_option
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Policy file; default policy-<scenario>-<seed>.onnx; with --seeds, -<seed> is added. A card (.json) goes"
    " beside it.",
)
def command(
    scenario: str,
    backend: Literal["twin", "diagram"],
    steps: int | None,
    seed: int,
    seeds: int,
    resume: bool,
    evaluate_every: int | None,
    patience: int | None,
    tensorboard: Path | None,
    episodes: int | None,
    overrides: tuple[str, ...],
    out: Path | None,
) -> None:
    """Train a policy for SCENARIO on its people's training trials, and write it as ONNX.

    On the twin, the whole state is kept beside the policy file about every tenth of the training: after Ctrl-C or a
    crash, the same command with --resume goes on, and ends in the same network. The policy is evaluated on the
    scenario's own split (validation trials), in the course of training and, on other episodes, at the end.
    """
    from rich.console import Console

    from pace_drake.errors import InputError
    from pace_drake.files import check_file, check_folder
    from pace_drake.scenario import load_scenario

    for option, given in (("--resume", resume), ("--patience", patience), ("--evaluate-every", evaluate_every)):
        if given and backend == "diagram":
            raise InputError(
                f"{option}: checkpoints and evaluations are of trainings on the twin, not --backend diagram"
            )
    if tensorboard is not None and find_spec("tensorboard") is None:
        raise InputError("--tensorboard needs the package tensorboard: install it with pip install 'pace_drake[train]'")
    try:
        from pace_drake.learning.ppo import TWIN_SETTINGS, PPOSettings
    except ModuleNotFoundError as error:
        raise InputError(f"training needs {error.name}: install it with pip install 'pace_drake[train]'") from error
    from pace_drake.learning.checkpoint import checkpoint_path
    from pace_drake.people import load_people

    settings = TWIN_SETTINGS if backend == "twin" else PPOSettings()
    if steps is not None:
        settings = replace(settings, steps=steps)
    paths: dict[int, Path] = {}
    for one in range(seed, seed + seeds):
        path = out or Path(f"policy-{Path(scenario).stem}-{one}.onnx")
        if path.suffix != ".onnx":
            raise InputError(f"{path}: a policy file must end in .onnx")
        paths[one] = path.with_name(f"{path.stem}-{one}.onnx") if out and seeds > 1 else path
        check_file(paths[one])
    if tensorboard is not None:
        check_folder(tensorboard)
    loaded = load_scenario(scenario, overrides)
    people = load_people(loaded)
    console = Console()
    own = {one: replace(settings, seed=one) for one in paths}
    facts = {one: {"backend": backend, "settings": asdict(own[one]), "versions": versions()} for one in paths}
    # Of several trainings, those before the interrupted one are done, those after it have not begun.
    cards = {one: done for one, path in paths.items() if resume and (done := _finished(path, loaded, facts[one]))}
    for one, path in paths.items():
        if one in cards:
            console.print(f"{path}: is done already", markup=False, highlight=False, soft_wrap=True)
        else:
            _refuse_to_replace(path, resume)
    for one, path in paths.items():
        if one in cards:
            continue
        evaluator = _Evaluation(people, evaluate_every, patience) if backend == "twin" else None
        begun = resume and (checkpoint_path(path).exists() or seeds == 1)
        model, more = _train(loaded, own[one], backend, path, evaluator, begun, tensorboard, console)
        cards[one] = {**facts[one], **more}
        _write(model, loaded, people, path, cards[one])
    _finish(loaded, people, paths, cards, episodes, console)


@dataclass(frozen=True)
class _Evaluation:
    """What is asked of the evaluations in the course of training; see the options."""

    people: "People"
    every: int | None
    patience: int | None


def versions() -> dict[str, str]:
    """Of what a policy was made with, by package."""
    return {name: version(name) for name in ("pace_drake", "drake", "stable-baselines3", "torch", "onnx", "numpy")}


def _refuse_to_replace(path: Path, resume: bool) -> None:
    """Raises InputError where a training would overwrite a policy, its card, or what is kept of one."""
    from pace_drake.errors import InputError
    from pace_drake.learning.checkpoint import checkpoint_path

    checkpoint = checkpoint_path(path)
    if checkpoint.exists():
        if not resume:
            raise InputError(
                f"{checkpoint}: is of a training that was interrupted; --resume goes on with it, or choose another"
                " --out, or remove it"
            )
        return
    for file in (path, path.with_suffix(".json")):
        if file.exists():
            what = "is not what this command would make" if resume else "exists"
            raise InputError(f"{file}: {what}; choose another --out, or remove it")


def _finished(path: Path, scenario: "Scenario", facts: Mapping[str, Any]) -> dict[str, Any] | None:
    """The card of a policy that this very command has written before; else None."""
    import json

    from pace_drake.learning.checkpoint import checkpoint_path
    from pace_drake.scenario import scenario_hash

    if checkpoint_path(path).exists():
        return None
    try:
        card = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    same = isinstance(card, dict) and all(card.get(name) == value for name, value in facts.items())
    return card if same and path.exists() and card.get("scenario_hash") == scenario_hash(scenario) else None


def _train(
    scenario: "Scenario",
    settings: "PPOSettings",
    backend: Literal["twin", "diagram"],
    path: Path,
    evaluation: "_Evaluation | None",
    resume: bool,
    tensorboard: Path | None,
    console: "Console",
) -> tuple["PPO", dict[str, Any]]:
    """Trains one policy: (the agent, what its card says of the training)."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from pace_drake.learning.checkpoint import checkpoint_path
    from pace_drake.learning.evaluator import EPISODES as EVALUATED
    from pace_drake.learning.evaluator import EVALUATION_SEED, Evaluator
    from pace_drake.learning.ppo import train_ppo

    columns = (TextColumn(f"PPO, seed {settings.seed}, decisions"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeRemainingColumn(), TextColumn("{task.fields[cost]}"), console=console) as bar:
        rollout = settings.num_envs * settings.rollout
        item = bar.add_task("", total=-(-settings.steps // rollout) * rollout, cost="")
        evaluator = None
        if evaluation is not None:
            evaluator = Evaluator(
                scenario,
                evaluation.people,
                evaluation.every or max(settings.steps // 10, 1),
                evaluation.patience,
                lambda _, cost: bar.update(item, cost=f"cost {cost:.2f} s"),
            )
        try:
            model = train_ppo(
                scenario,
                settings,
                lambda done: bar.update(item, completed=done),
                backend,
                evaluator=evaluator,
                policy_file=path,
                resume=resume,
                tensorboard=tensorboard,
            )
        except KeyboardInterrupt:
            kept = checkpoint_path(path)
            what = (
                f"{kept} is kept; the same command with --resume goes on" if kept.exists() else "nothing was kept yet"
            )
            raise KeyboardInterrupt(
                what if backend == "twin" else "--backend diagram keeps no checkpoints: nothing was kept"
            ) from None
    more: dict[str, Any] = {"decisions": model.num_timesteps, "seeds": {"training": settings.seed}}
    if evaluator is not None and evaluator.best is not None:
        more["seeds"] |= {"evaluation": EVALUATION_SEED}
        more["evaluation"] = {
            "episodes": EVALUATED,
            "best": {"decisions": evaluator.best[0], "cost": evaluator.best[1]},
            "history": evaluator.history,
        }
    return model, more


def _write(model: "PPO", scenario: "Scenario", people: "People", path: Path, card: dict[str, Any]) -> None:
    from pace_drake.learning.checkpoint import checkpoint_path, remove_checkpoint
    from pace_drake.learning.export import export_policy

    export_policy(model, scenario, people, path, card)
    remove_checkpoint(checkpoint_path(path))


def _finish(
    scenario: "Scenario",
    people: "People",
    paths: Mapping[int, Path],
    cards: Mapping[int, dict[str, Any]],
    episodes: int | None,
    console: "Console",
) -> None:
    """Scores the exported files on the same episodes, completes their cards, and says what came out."""
    from rich.table import Table

    from pace_drake.learning.export import write_card

    results = dict(zip(paths, _scores(scenario, people, list(paths.values()), episodes), strict=True))
    for seed, path in paths.items():
        score = results[seed].to_json()
        for name in ("policy", "saving", "saving_interval"):
            del score[name]
        about = {"split": scenario.human.split, "people": people.description}
        card = {**cards[seed], "seeds": {**cards[seed]["seeds"], "score": SCORE_SEED}}
        write_card(path, {**card, "score": {**score, **about}})

    def cost(seed: int) -> str:
        low, high = results[seed].cost_interval
        return f"{results[seed].cost:.2f} ± {(high - low) / 2:.2f}"

    best = min(paths, key=lambda seed: results[seed].cost)
    robot, human = ({s: f"{sum(getattr(r, n)):.2f}" for s, r in results.items()} for n in ("robot_idle", "human_idle"))
    number = f"{results[best].episodes} episodes ({scenario.human.split} trials)"
    if len(paths) > 1:
        table = Table(title=f"{scenario.name}, the same {number}: seconds", title_justify="left")
        for head in ("seed", "cost", "robot idle", "human idle"):
            table.add_column(head, justify="right")
        for seed in paths:
            table.add_row(str(seed), cost(seed), robot[seed], human[seed], style="bold" if seed == best else None)
        console.print(table)
        console.print(f"best: seed {best}", highlight=False)
    else:
        console.print(
            f"mean cost over {number}: [bold]{cost(best)} s[/bold] (robot idle {robot[best]} s, human idle"
            f" {human[best]} s)",
            highlight=False,
            soft_wrap=True,
        )
    lines = (
        f"policy: {paths[best]}, card: {paths[best].with_suffix('.json')}",
        f"run it with: pace run {scenario.name} --policy {paths[best]}",
    )
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True, markup=False)


def _scores(scenario: "Scenario", people: "People", paths: list[Path], episodes: int | None) -> "list[PolicyResult]":
    import numpy as np

    from pace_drake.evaluate.agreement import check_by_diagram, play_in_diagram
    from pace_drake.evaluate.policies import POOL_SIZE, play_policies, summarize
    from pace_drake.policies.learned import LearnedPolicy

    policies = {str(path): LearnedPolicy(path, scenario.task, scenario.observation) for path in paths}
    if scenario.human.monitor != "told":
        rng = [np.random.default_rng([SCORE_SEED, k]) for k in range(episodes or DIAGRAM_EPISODES)]
        drawn = [people.sample(scenario, one) for one in rng]
        played = {name: play_in_diagram(scenario, people, policy, drawn) for name, policy in policies.items()}
        return [summarize(name, one, one) for name, one in played.items()]

    from pace_drake.envs.pool import cached_pool
    from pace_drake.envs.twin import AssemblyTwin

    pool = cached_pool(scenario, people, POOL_SIZE, SCORE_SEED)
    parts = pool.sample(episodes or EPISODES, np.random.default_rng(SCORE_SEED))
    checked = parts[:CHECKED]
    for policy in policies.values():
        check_by_diagram(AssemblyTwin(scenario, pool, len(checked)), checked, policy, people)
    return play_policies(AssemblyTwin(scenario, pool, len(parts)), parts, policies)
