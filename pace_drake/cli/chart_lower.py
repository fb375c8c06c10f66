"""``pace chart lower``: writes a chart for other engines."""

from pathlib import Path

import click

from pace_drake.cli.chart import chart_path, write_text
from pace_drake.errors import InputError
from pace_drake.files import check_file


@click.command()
@click.argument("file")
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="What to write: .scxml or .yaml.")
def command(file: str, out: Path) -> None:
    """Write the statechart FILE as plain SCXML (-o x.scxml) or for sismic (-o x.yaml).

    Preemption is written into the guards, so that any SCXML engine runs it; one reaction is one event `react`.
    """
    from pace_drake.statechart import compile_chart, load_chart
    from pace_drake.statechart.lower import to_scxml, to_sismic

    writers = {".scxml": to_scxml, ".yaml": to_sismic}
    if out.suffix not in writers:
        raise InputError(f"{out}: the name must end in {' or '.join(writers)}")
    check_file(out)
    path = chart_path(file)
    if out.exists() and out.samefile(path):
        raise InputError(f"{out}: would overwrite the chart itself; choose another name")
    write_text(out, writers[out.suffix](compile_chart(load_chart(path))))
