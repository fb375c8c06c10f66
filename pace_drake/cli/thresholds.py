"""``pace thresholds``: the best threshold rules of a scenario."""

import click


@click.command("thresholds", short_help="Find the best elapsed-time and phase thresholds of a scenario.")
@click.argument("scenario", default="ikea_chair")
@click.option("--episodes", type=click.IntRange(min=1), default=200, show_default=True, help="Episodes per candidate.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the episodes.")
@click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a value of the scenario.")
def command(scenario: str, episodes: int, seed: int, overrides: tuple[str, ...]) -> None:
    """Find the best thresholds for SCENARIO on its training trials, and print them as the scenario writes them."""
    import yaml
    from rich.progress import Progress

    from pace_drake.evaluate.thresholds import ELAPSED_FRACTIONS, PHASES, search_thresholds
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, (*overrides, "human.split=train"))

    def search(name: str, element: int, num_candidates: int) -> None:
        with Progress() as bar:
            item = bar.add_task(name, total=num_candidates)
            found = search_thresholds(loaded, element, episodes, seed, lambda done: bar.update(item, completed=done))
        line = yaml.safe_dump(found.thresholds, default_flow_style=True, sort_keys=False).strip()
        click.echo(f"{name}: {line}  # mean cost {found.cost:.2f} s over {episodes} episodes")

    search("elapsed_threshold", 2, len(ELAPSED_FRACTIONS))
    search("phase_threshold", 3, len(PHASES))
