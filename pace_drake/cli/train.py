"""``pace train``: learns when to assist."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

if TYPE_CHECKING:
    from rich.console import Console
    from stable_baselines3 import PPO

    from pace_drake.learning.ppo import PPOSettings
    from pace_drake.scenario import Scenario


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
    help="Decisions to train on; default 1,000,000 with the twin, 20,000 with the diagram.",
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of everything random.")
@click.option(
    "--episodes",
    type=click.IntRange(min=1),
    default=100,
    show_default=True,
    help="Episodes of the final evaluation.",
)
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a value of the scenario.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Policy file; default policy-<scenario>-<seed>.onnx. A card (.json) goes beside it.",
)
def command(
    scenario: str,
    backend: Literal["twin", "diagram"],
    steps: int | None,
    seed: int,
    episodes: int,
    overrides: tuple[str, ...],
    out: Path | None,
) -> None:
    """Train a policy for SCENARIO on its people's training trials, and write it as ONNX.

    The policy is evaluated on the scenario's own split (validation trials) at the end.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from pace_drake.errors import InputError
    from pace_drake.scenario import load_scenario

    try:
        from pace_drake.learning.ppo import TWIN_SETTINGS, PPOSettings, train_ppo
    except ModuleNotFoundError as error:
        raise InputError(f"training needs {error.name}: install it with pip install 'pace_drake[train]'") from error
    path = out or Path(f"policy-{Path(scenario).stem}-{seed}.onnx")
    if path.suffix != ".onnx":
        raise InputError(f"{path}: a policy file must end in .onnx")
    if not path.parent.is_dir():
        raise InputError(f"{path.parent}: no such folder for the policy")
    loaded = load_scenario(scenario, overrides)
    settings = replace(TWIN_SETTINGS if backend == "twin" else PPOSettings(), seed=seed)
    if steps is not None:
        settings = replace(settings, steps=steps)
    console = Console()
    columns = (TextColumn("PPO, decisions"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        rollout = settings.num_envs * settings.rollout
        item = bar.add_task("", total=-(-settings.steps // rollout) * rollout)
        model = train_ppo(loaded, settings, lambda done: bar.update(item, completed=done), backend)
    _finish(model, loaded, settings, backend, path, episodes, console)


def _finish(
    model: "PPO",
    scenario: "Scenario",
    settings: "PPOSettings",
    backend: str,
    path: Path,
    episodes: int,
    console: "Console",
) -> None:
    from dataclasses import asdict

    import numpy as np

    from pace_drake.diagram import Assembly
    from pace_drake.evaluate.episode import mean_result, run_episode
    from pace_drake.learning.export import export_policy, write_card
    from pace_drake.policies.factory import make_policy
    from pace_drake.simulation import Simulation

    packages = ("pace_drake", "drake", "stable-baselines3", "torch", "onnx")
    card = {
        "backend": backend,
        "settings": asdict(settings),
        "decisions": model.num_timesteps,
        "versions": {name: version(name) for name in packages},
    }
    export_policy(model, scenario, path, card)
    simulation = Simulation(Assembly(scenario, make_policy(str(path), scenario)))
    rng = [np.random.default_rng([10_000 + settings.seed, k]) for k in range(episodes)]
    mean = mean_result([run_episode(simulation, simulation.sample_episode(r)) for r in rng])
    score = {
        "episodes": episodes,
        "split": scenario.human.split,
        "people": simulation.assembly.people.description,
    }
    score |= {key: mean[key] for key in ("cost", "robot_idle", "human_idle", "decisions", "phase_rmse")}
    write_card(path, scenario, {**card, "score": score})
    console.print(
        f"mean cost over {episodes} episodes ({scenario.human.split} trials): [bold]{mean['cost']:.2f} s[/bold] "
        f"(robot idle {mean['robot_idle']['total']:.2f} s, human idle {mean['human_idle']['total']:.2f} s)",
        highlight=False,
    )
    console.print(f"policy: {path}, card: {path.with_suffix('.json')}", highlight=False, soft_wrap=True)
    console.print(f"run it with: pace run {scenario.name} --policy {path}", highlight=False, soft_wrap=True)
