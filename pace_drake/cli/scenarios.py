"""``pace scenarios``: what can be run."""

import click


@click.command("scenarios", short_help="List the scenarios and policies that come with the project.")
def command() -> None:
    """List the scenarios and policies that come with the project."""
    from rich.console import Console
    from rich.table import Table

    from pace_drake.policies.factory import POLICIES
    from pace_drake.scenario import load_scenario, scenario_names

    table = Table("scenario", "human actions (joint in brackets)", "robot tasks", "description")
    for name in scenario_names():
        scenario = load_scenario(name)
        actions = [f"({a.name})" if a.joint else a.name for a in scenario.task.human_actions]
        table.add_row(
            name,
            ", ".join(actions),
            ", ".join(r.name for r in scenario.task.robot_tasks),
            scenario.description,
        )
    console = Console()
    console.print(table)
    console.print(f"policies: {', '.join(POLICIES)}, or a file ending in .onnx")
