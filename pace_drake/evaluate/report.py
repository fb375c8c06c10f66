"""Tables for people, and one HTML page that needs nothing else."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from pace_drake import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Table:
    """A table for people: the first column names the rows."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


def new_figure(width: float, height: float) -> "Figure":
    """A figure of this size [inch] that can be saved as PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def html_page(
    title: str,
    paragraphs: Sequence[str],
    command_line: str,
    tables: Sequence[Table],
    pictures: Mapping[str, bytes],
    about: Mapping[str, str],
    synthetic: str,
) -> str:
    """The whole page.

    Args:
        title: of the page.
        paragraphs: what stands before the tables.
        command_line: that makes it.
        tables: in order.
        pictures: name -> PNG.
        about: what each thing in the tables is.
        synthetic: what is synthetic; empty if nothing is.
    """
    import jinja2

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    return environment.from_string(_PAGE).render(
        title=title,
        paragraphs=paragraphs,
        command_line=command_line,
        version=__version__,
        tables=tables,
        pictures={name: base64.b64encode(content).decode("ascii") for name, content in pictures.items()},
        about=about,
        synthetic=synthetic,
    )


_PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{{ title }}</title>
<style>
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; font-size: .9rem; } .wide { overflow-x: auto; }
th, td { padding: .25rem .7rem; text-align: right; border-bottom: 1px solid #ddd; }
th:first-child, td:first-child { text-align: left; } thead th { border-bottom: 2px solid #888; }
img { max-width: 100%; } code { background: #f3f3f3; padding: .1rem .3rem; }
.synthetic { border: 2px solid #D55E00; padding: .5rem 1rem; } dt { font-weight: 600; }
</style>
</head>
<body>
<h1>{{ title }}</h1>
{% if synthetic %}
<p class="synthetic"><strong>SYNTHETIC</strong>: {{ synthetic }}</p>
{% endif %}
{% for paragraph in paragraphs %}
<p>{{ paragraph }}</p>
{% endfor %}
<p>Made by pace_drake {{ version }} with <code>{{ command_line }}</code></p>
{% for table in tables %}
<h2>{{ table.title }}</h2>
<div class="wide"><table>
<thead><tr>{% for column in table.columns %}<th>{{ column }}</th>{% endfor %}</tr></thead>
<tbody>
{% for row in table.rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>
{% endfor %}
</tbody>
</table></div>
{% endfor %}
<h2>Figures</h2>
{% for name, content in pictures.items() %}
<p><img alt="{{ name }}" src="data:image/png;base64,{{ content }}"></p>
{% endfor %}
<h2>What the rows are</h2>
<dl>
{% for name, text in about.items() %}
<dt>{{ name }}</dt><dd>{{ text }}</dd>
{% endfor %}
</dl>
</body>
</html>
"""
