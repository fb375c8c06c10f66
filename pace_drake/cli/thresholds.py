"""``pace thresholds``: the best threshold rules of a scenario."""

import click

from pace_drake.cli.options import set_option


@click.command("thresholds", short_help="Find the best thresholds of elapsed time, phase and remaining time.")
@click.argument("scenario", default="ikea_chair")
@click.option("--episodes", type=click.IntRange(min=1), default=4000, show_default=True, help="Episodes per candidate.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the episodes.")
@set_option
def command(scenario: str, episodes: int, seed: int, overrides: tuple[str, ...]) -> None:
    """Find the best thresholds for SCENARIO on its training trials, and print them as the scenario writes them."""
    import numpy as np
    import yaml
    from rich.progress import Progress

    from pace_drake.envs.pool import make_pool
    from pace_drake.envs.twin import AssemblyTwin
    from pace_drake.evaluate.policies import POOL_SIZE
    from pace_drake.evaluate.thresholds import RULES, num_candidates, search_thresholds
    from pace_drake.people import load_people
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, (*overrides, "human.split=train"))
    rng = np.random.default_rng(seed)
    pool = make_pool(loaded, load_people(loaded), POOL_SIZE, rng)
    parts = pool.sample(episodes, rng)
    twin = AssemblyTwin(loaded, pool, episodes)
    for rule in RULES:
        with Progress() as bar:
            item = bar.add_task(rule, total=num_candidates(rule))
            found = search_thresholds(twin, parts, rule, lambda done: bar.update(item, completed=done))  # noqa: B023
        line = yaml.safe_dump(found.thresholds, default_flow_style=True, sort_keys=False).strip()
        click.echo(f"{rule}: {line}  # mean cost {found.cost:.2f} s over {episodes} episodes")
