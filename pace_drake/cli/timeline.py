"""``pace timeline``: draws the timeline of a run again."""

from pathlib import Path

import click


@click.command("timeline", short_help="Draw who did what when, from a run folder.")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--episode", default=0, show_default=True, help="Which episode of the run [0-based].")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Picture: .png, .svg or .pdf; default RUN/timeline.png.",
)
def command(run: Path, episode: int, output: Path | None) -> None:
    """Draw who did what when, from the events in the folder RUN; works on a run that was killed, too."""
    from pace_drake.errors import InputError
    from pace_drake.evaluate.timeline import check_picture, draw_timeline, read_events
    from pace_drake.files import write_whole
    from pace_drake.scenario import load_scenario

    if not (run / "events.csv").is_file():
        raise InputError(f"{run}: not a run folder, it has no events.csv")
    path = output or run / "timeline.png"
    check_picture(path)
    scenario = load_scenario(str(run / "scenario.yaml"))
    events = read_events(run / "events.csv", episode)
    if not events:
        raise InputError(f"{run / 'events.csv'}: has no episode {episode}")
    write_whole(path, lambda part: draw_timeline(events, scenario.task, f"{scenario.name}, episode {episode}", part))
    click.echo(path)
