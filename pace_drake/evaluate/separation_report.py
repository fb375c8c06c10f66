"""Speed and separation monitoring on paper: figures, histograms, one page."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pace_drake.evaluate.report import Table, html_page, new_figure
from pace_drake.evaluate.separation import CHECK_STEP, SeparationResult
from pace_drake.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = {
    "strict": "no part closes in inside the protective distance (contact_speed 0).",
    "scenario": "inside it, parts close in with contact_speed at most, and stop short of a still hand.",
    "too near": (
        "instants at which a part closes in faster than contact_speed (strict: at all) and is nearer than the"
        " protective distance of its closing speed; of these, violations are those at which it has been so for longer"
        " than the reaction time."
    ),
}


@dataclass(frozen=True)
class SeparationReport:
    """All that the report is made of."""

    title: str
    results: Sequence[SeparationResult]
    time_to_standstill: float
    """[s] from the last sample of a hand that is not seen any more."""
    hand_timeout: float
    """[s]"""


def tables(report: SeparationReport) -> list[Table]:
    """One row of figures per mode."""
    columns = [
        "", "hand\nmotions", "instants", "too near", "violations", "least\ndistance [m]", "slowed\n[%]", "stopped\n[%]",
        "hands that\ntouch", "robot's speed\nthen, max [m/s]", "distance\nerror [mm]",
    ]  # fmt: skip
    rows = [
        [
            r.name,
            f"{r.num_motions}",
            f"{r.instants}",
            f"{r.below}",
            f"{r.violations}",
            f"{r.least_distance:.3f}",
            f"{100 * r.share_slowed:.1f}",
            f"{100 * r.share_stopped:.1f}",
            f"{len(r.contact_speeds)}",
            f"{max(r.contact_speeds, default=0.0):.3f}",
            f"{1000 * r.distance_error:.4f}",
        ]
        for r in report.results
    ]
    text = f"Hands reach for the robot, SYNTHETIC; looked at every {1000 * CHECK_STEP:g} ms"
    standstill = [
        ["hand not seen any more", f"{report.hand_timeout:.2f}", f"{report.time_to_standstill:.2f}"],
    ]
    return [
        Table(text, columns, rows),
        Table("Stale hand signal", ["", "timeout [s]", "arm at rest after [s]"], standstill),
    ]


def to_json(report: SeparationReport) -> dict[str, Any]:
    """Every figure."""
    return {"synthetic": True, **asdict(report)}


def write_report(folder: Path, report: SeparationReport, command_line: str) -> None:
    """Writes separation.png and index.html into a folder."""
    figure = _draw(report)
    write_whole(folder / "separation.png", lambda part: figure.savefig(part))
    paragraphs = [
        "The planned motions are led by the robot action and the safety monitor of the diagram; the arm is where it is"
        " told to be. Hands reach for a part of the arm, start suddenly, hover, sweep through and retreat, neither hand"
        " nor forearm faster than the human speed that the formulas assume. Nothing stops a hand: it passes through the"
        " arm, so least distances may be negative; what counts is what the robot does.",
        "The check shares nothing with the monitor: forward kinematics by the published table, distances by search,"
        " closing speeds by finite differences of positions, with the limb held still.",
    ]
    html = html_page(
        f"Speed and separation monitoring: {report.title}",
        paragraphs,
        command_line,
        tables(report),
        {"separation.png": (folder / "separation.png").read_bytes()},
        ABOUT,
        "random hand motions, nobody was recorded; a kinematic arm. No statement about a real robot.",
    )
    write_whole(folder / "index.html", lambda part: part.write_text(html, encoding="utf-8"))


def _draw(report: SeparationReport) -> "Figure":
    """Histograms of least distances and greatest closing speeds, over hand motions."""
    figure = new_figure(9.5, 3.8)
    axes = figure.subplots(1, 2)
    for values, ax, label in (
        ([r.least_distances for r in report.results], axes[0], "least distance of a hand motion [m]"),
        ([r.closing_speeds for r in report.results], axes[1], "greatest closing speed of the robot in it [m/s]"),
    ):
        bins = np.linspace(min(map(min, values)), max(map(max, values)), 41)
        for result, series, colour in zip(report.results, values, ("#0072B2", "#D55E00"), strict=False):
            ax.hist(series, bins, histtype="step", lw=1.6, color=colour, label=result.name)
        ax.set_xlabel(label)
        ax.grid(alpha=0.3)
    axes[0].axvline(0.0, color="black", lw=0.8)
    axes[0].set_ylabel("hand motions")
    axes[0].legend(fontsize=9)
    figure.suptitle(f"{report.title}: SYNTHETIC hands", fontsize=10)
    return figure
