"""``pace export``: a policy that Stable-Baselines3 saved, as ONNX."""

from pathlib import Path

import click

from pace_drake.cli.options import set_option


@click.command("export", short_help="Make a policy file of a Stable-Baselines3 .zip.")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False, exists=True))
@click.argument("scenario", default="ikea_chair")
@click.option("--trust-pickle", is_flag=True, help="FILE is a pickle, which may run anything: you trust its maker.")
@set_option
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="Policy file (.onnx); a card (.json) goes beside it.",
)
def command(file: Path, scenario: str, trust_pickle: bool, overrides: tuple[str, ...], out: Path) -> None:
    """Read a PPO or A2C agent that Stable-Baselines3 saved as FILE, and write its policy for SCENARIO as ONNX.

    Such a file is a pickle: whoever made it can have anything run where it is read. It is read only with
    --trust-pickle, and here only; an ONNX file runs nothing.
    """
    import zipfile
    from hashlib import sha256

    from pace_drake.errors import InputError
    from pace_drake.files import check_file

    if not trust_pickle:
        raise InputError(
            f"{file}: is not read: files of Stable-Baselines3 hold pickles, which can run anything; add --trust-pickle"
            " if you trust its maker"
        )
    if out.suffix != ".onnx":
        raise InputError(f"{out}: a policy file must end in .onnx")
    check_file(out)
    if not zipfile.is_zipfile(file):
        raise InputError(f"{file}: no .zip that Stable-Baselines3 saved")

    from pace_drake.cli.train import versions
    from pace_drake.people import load_people
    from pace_drake.scenario import load_scenario

    loaded = load_scenario(scenario, overrides)
    try:
        from pace_drake.learning.export import export_policy, read_agent
    except ModuleNotFoundError as error:
        raise InputError(f"export needs {error.name}: install it with pip install 'pace_drake[train]'") from error
    model = read_agent(file, loaded)
    content = sha256(file.read_bytes()).hexdigest()
    card = {
        "source": {"file": file.name, "sha256": content},
        "decisions": model.num_timesteps,
        "seeds": {"training": model.seed},
        "versions": versions(),
    }
    export_policy(model, loaded, load_people(loaded), out, card)
    click.echo(f"policy: {out}, card: {out.with_suffix('.json')}")
    click.echo(f"run it with: pace run {loaded.name} --policy {out}")
