"""``pace demos``: writes the synthetic demonstrations to a file."""

from pathlib import Path

import click


@click.command("demos", short_help="Write synthetic demonstrations of hand motion to a file.")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the people.")
@click.option("--subjects", type=click.IntRange(min=1), default=5, show_default=True, help="How many people.")
@click.option("--trials", type=click.IntRange(min=1), default=4, show_default=True, help="Trials of each action.")
def command(file: Path, seed: int, subjects: int, trials: int) -> None:
    """Write synthetic demonstrations, and one reference per action, to FILE (.npz or .csv); labelled as synthetic.

    Positions of the right hand in world [m] at 10 Hz, for place_rails, place_screws and tighten_screws.
    """
    from pace_drake.demos import generate_demonstrations, write_demonstrations
    from pace_drake.errors import InputError
    from pace_drake.files import check_file

    if file.exists():
        raise InputError(f"{file}: exists; choose another file, or remove it")
    check_file(file)
    people = generate_demonstrations(seed=seed, num_subjects=subjects, num_trials=trials)
    recordings = [*people.references, *people.demonstrations]
    write_demonstrations(file, recordings)
    click.echo(f"{file}: {len(recordings)} SYNTHETIC demonstrations of {', '.join(people.actions)}")
