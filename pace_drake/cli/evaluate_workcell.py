"""``pace evaluate workcell``: whether the robot of the plant level really does it."""

from pathlib import Path

import click

from pace_drake.cli.options import set_option
from pace_drake.cli.outputs import check_outputs, json_option, write_json
from pace_drake.cli.tables import rich_table, wide_console


@click.command("workcell", short_help="Sorts, joint actions and limits at the plant level.")
@click.argument("scenario", default="ikea_chair")
@click.option("--episodes", type=click.IntRange(min=1), default=20, show_default=True, help="How many.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the episodes.")
@click.option("--policy", help="Policy name or .onnx file; default the scenario's.")
@set_option
@json_option
def workcell(
    scenario: str, episodes: int, seed: int, policy: str | None, overrides: tuple[str, ...], json_file: Path | None
) -> None:
    """Play episodes of SCENARIO with the whole plant, components lying at random, and check from the log of every step
    that cubes end in their trays, joint actions are done, and no limit is passed.
    """
    check_outputs(json_file, None)

    from rich.progress import track

    from pace_drake.diagram import FULL_LOG, Assembly, make_plant_assembly
    from pace_drake.evaluate.workcell import play_workcell, summarize, table
    from pace_drake.people import load_people
    from pace_drake.policies.factory import make_policy
    from pace_drake.scenario import load_scenario
    from pace_drake.simulation import Simulation

    loaded = load_scenario(scenario, overrides)
    chosen = make_policy(policy or loaded.policy, loaded)
    people = load_people(loaded)
    plant = Simulation(make_plant_assembly(loaded, chosen, people=people, logged=FULL_LOG))
    alone = Simulation(Assembly(loaded, chosen, people=people))
    console = wide_console()
    numbers = track(range(episodes), description="episodes", console=console, transient=True)
    played = list(play_workcell(plant, alone, seed, numbers))
    summary = summarize(played, loaded.task.num_joint_actions)
    console.print(people.description, markup=False, highlight=False, soft_wrap=True)
    console.print(rich_table(table(summary)))
    if json_file is not None:
        write_json(json_file, summary)
