"""``pace diagram``: Drake's own picture of the block diagram."""

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pace_drake.cli.options import set_option, with_values
from pace_drake.errors import InputError

if TYPE_CHECKING:
    from pace_drake.diagram import Assembly

_KINDS = (".svg", ".png", ".dot")


@click.command("diagram", short_help="Draw the block diagram: systems, ports, connections.")
@click.argument("scenario", default="ikea_chair")
@click.option(
    "--level",
    type=click.Choice(["plant", "task"]),
    default="plant",
    show_default=True,
    help="plant: with the station; task: without.",
)
@click.option(
    "--depth",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="How far diagrams in the diagram are opened: 0 shows one block, 2 the inside of the station.",
)
@click.option("--policy", help="Policy name or .onnx file; default the scenario's.")
@set_option
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("diagram.svg"),
    show_default=True,
    help="Picture (.svg, .png), or .dot for Graphviz's text.",
)
def command(
    scenario: str, level: str, depth: int, policy: str | None, overrides: tuple[str, ...], output: Path
) -> None:
    """Draw the block diagram of SCENARIO (a name or a .yaml file), as Drake writes it.

    A picture needs Graphviz's dot, or what pip install 'pace_drake[diagram]' brings; a .dot file needs neither.
    """
    from pace_drake.files import check_file, write_whole
    from pace_drake.graphviz import draw_dot, find_dot

    if output.suffix not in _KINDS:
        raise InputError(f"{output}: the name must end in {', '.join(_KINDS[:-1])} or {_KINDS[-1]}")
    check_file(output)
    if output.suffix != ".dot":
        find_dot()  # says what is missing, before anything is built
    text = _assembly(scenario, level, policy, overrides).GetGraphvizString(max_depth=depth)
    # Class names without their modules: boxes half as wide.
    text = re.sub(r"<B>(?:\w+\.)+(\w+)</B>", r"<B>\1</B>", text)
    picture = text.encode() if output.suffix == ".dot" else draw_dot(text, output.suffix[1:])
    write_whole(output, lambda part: part.write_bytes(picture))
    click.echo(output)


def _assembly(name: str, level: str, policy: str | None, overrides: tuple[str, ...]) -> "Assembly":

    from pace_drake.diagram import Assembly, make_plant_assembly
    from pace_drake.policies.factory import make_policy
    from pace_drake.scenario import load_scenario

    scenario = load_scenario(name, with_values(overrides, policy=policy))
    chosen = make_policy(scenario.policy, scenario)
    return Assembly(scenario, chosen) if level == "task" else make_plant_assembly(scenario, chosen)
