"""What people read: tables, a CSV file, pictures, and a page that needs nothing else."""

import csv
import math
import re
from html.parser import HTMLParser

import pytest

from pace_drake.evaluate.phase import ESTIMATORS, FUSED, PAPER_TABLE_II, WP, evaluate, fit
from pace_drake.evaluate.phase_report import ABOUT, page, tables, write_report
from tests.evaluate.test_phase import TUNED, evaluated
from tests.evaluate.test_tuning import tiny_signals

COMMAND = "pace evaluate phase --data 'my <data>'"


@pytest.fixture(scope="module")
def evaluation():
    signals = tiny_signals(synthetic=True)
    return evaluate(signals, [fit(action, TUNED) for action in signals.actions])


@pytest.fixture(scope="module")
def folder(evaluation, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    write_report(folder, evaluation, COMMAND)
    return folder


def test_the_tables(evaluation):
    phase, remaining, by_action, paper = tables(evaluation)
    for table in (phase, remaining, by_action, paper):
        assert {len(row) for row in table.rows} == {len(table.columns)}
    assert "SYNTHETIC" in phase.title
    for table in (phase, remaining, by_action):
        assert tuple(row[0] for row in table.rows) == ESTIMATORS
    row = dict(zip(phase.columns, phase.rows[ESTIMATORS.index(WP)], strict=True))
    assert row["MSE\ntrain"] == f"{evaluation.mean(WP, 'train').mse:.4f}"
    assert row["MSE\nheld-out\npeople"] == f"{evaluation.mean(WP, 'heldout_people').mse:.4f}"
    fused = remaining.rows[ESTIMATORS.index(FUSED)]
    assert fused[1] == f"{evaluation.mean(FUSED, 'heldout_people').remaining_time_error[0]:.2f}"
    assert [row[-1] == "-" for row in remaining.rows] == [name != FUSED for name in ESTIMATORS]
    assert by_action.columns == ["", "lift", "put down"]
    assert "not comparable" in paper.title
    assert [row[0] for row in paper.rows] == list(PAPER_TABLE_II)
    assert paper.rows[2][1:] == ["0.002", "0.012", "0.006"]


def test_a_part_that_is_empty_is_a_dash():
    evaluation = evaluated(people=())
    phase, remaining, by_action, _ = tables(evaluation)
    assert "SYNTHETIC" not in phase.title
    column = phase.columns.index("MSE\nheld-out\npeople")
    assert {row[column] for row in phase.rows} == {"-"}
    for table in (phase, remaining, by_action):
        assert "held-out trials" in table.title
    assert "-" not in {cell for row in by_action.rows for cell in row}


def test_the_files(folder):
    assert sorted(path.name for path in folder.iterdir()) == ["errors.png", "fig7.png", "index.html", "scores.csv"]
    for name in ("errors.png", "fig7.png"):
        assert (folder / name).read_bytes().startswith(b"\x89PNG")


def test_the_csv_file(evaluation, folder):
    with (folder / "scores.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    expected = evaluation.rows()
    assert list(rows[0]) == list(expected[0])
    assert len(rows) == len(expected)
    for row, one in zip(rows, expected, strict=True):
        assert float(row["mse"]) == one["mse"]
        assert (row["coverage"] == "") == math.isnan(one["coverage"])
    assert "nan" not in (folder / "scores.csv").read_text()


class _Page(HTMLParser):
    """Collects what a browser would load, and the tags that are left open."""

    def __init__(self, text):
        super().__init__()
        self.loaded, self.tags, self.text = [], [], ""
        self.open = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in ("meta", "img"):
            self.open.append(tag)
        self.loaded += [value for name, value in attrs if name in ("src", "href", "srcset", "data")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_the_page_needs_nothing_else(folder):
    text = (folder / "index.html").read_text()
    parsed = _Page(text)
    assert parsed.open == []
    assert len(parsed.loaded) == 2
    assert all(source.startswith("data:image/png;base64,iVBOR") for source in parsed.loaded)
    assert not {"script", "link", "iframe", "object", "form"} & set(parsed.tags)
    assert not re.search(r"https?:|url\(|@import|file:", text)


def test_the_page_says_what_it_is_about(evaluation, folder):
    parsed = _Page((folder / "index.html").read_text())
    for text in (
        COMMAND,
        "SYNTHETIC: a generator made these signals",
        "waves & <shapes>",  # escaped, or it would be read as a tag
        "Source: tests. Licence: none. Units: m.",
        "not comparable",
        *ABOUT.values(),
        *(cell for table in tables(evaluation) for row in table.rows for cell in row),
    ):
        assert text in parsed.text
    assert set(ABOUT) == set(ESTIMATORS)


def test_real_signals_are_not_called_synthetic():
    evaluation = evaluated()
    assert "SYNTHETIC" not in page(evaluation, COMMAND, {})
