"""Sensitivity on paper: the Pareto front over lambda, and what else the results depend on."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pace_drake.evaluate.policy_report import ABOUT
from pace_drake.evaluate.report import Table, html_page, new_figure
from pace_drake.evaluate.sensitivity import OBSERVATIONS, CaseResult
from pace_drake.evaluate.worlds import FITTED, NO_PHASE, PERFECT, ppo_name
from pace_drake.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The rows that are shown.
SHOWN = (NO_PHASE, *(ppo_name(o) for o in OBSERVATIONS), FITTED, PERFECT)


@dataclass(frozen=True)
class Sensitivity:
    """All that the report is made of: cases over lambda and the others, of the same scenario and worlds."""

    title: str
    lambdas: Sequence[CaseResult]
    others: Sequence[CaseResult]


def tables(sensitivity: Sensitivity) -> list[Table]:
    """Idle times and costs by lambda, and costs in the other cases."""
    found = []
    if sensitivity.lambdas:
        rows = [[result.case.label, *(_idle(result, name) for name in SHOWN)] for result in sensitivity.lambdas]
        found.append(
            Table(
                f"Robot idle / human idle = cost [s] by lambda, SYNTHETIC unseen people{_worlds(sensitivity)}",
                ["", *SHOWN],
                rows,
            )
        )
    if sensitivity.others:
        rows = [
            [
                result.case.label,
                f"{np.mean([r.phase_rmse['unseen'] for r in result.results]):.3f}",
                *(f"{result.row(name).cost:.2f}" for name in SHOWN),
                *(f"{result.row(ppo_name(o)).cheaper:.1f}" for o in OBSERVATIONS[1:]),
            ]
            for result in sensitivity.others
        ]
        columns = [
            "",
            "phase error\nrms",
            *SHOWN,
            *(f"{ppo_name(o)}\ncheaper than\nno phase [%]" for o in OBSERVATIONS[1:]),
        ]
        found.append(Table(f"Cost [s], SYNTHETIC unseen people{_worlds(sensitivity)}", columns, rows))
    return found


def _worlds(sensitivity: Sensitivity) -> str:
    results = (*sensitivity.lambdas, *sensitivity.others)[0].results
    return f", mean of worlds {', '.join(str(r.seed) for r in results)}" if len(results) > 1 else ", one world"


def _idle(result: CaseResult, name: str) -> str:
    row = result.row(name)
    return f"{row.robot_idle_total:.1f} / {row.human_idle_total:.1f} = {row.cost:.2f}"


def to_json(sensitivity: Sensitivity) -> dict[str, Any]:
    """Every case, and in it every policy's row."""
    return {
        "title": sensitivity.title,
        "synthetic": True,
        "cases": [
            {
                "group": result.case.group,
                "value": result.case.value,
                "label": result.case.label,
                "phase_rmse": float(np.mean([r.phase_rmse["unseen"] for r in result.results])),
                "worlds": [r.seed for r in result.results],
                "policies": {name: result.row(name).to_json() for name in SHOWN},
            }
            for result in (*sensitivity.lambdas, *sensitivity.others)
        ],
    }


def write_report(folder: Path, sensitivity: Sensitivity, command_line: str) -> None:
    """Writes sensitivity.csv, pareto.png, cases.png and index.html into a folder."""
    write_whole(folder / "sensitivity.csv", lambda part: _write_csv(sensitivity, part))
    content = {}
    for name, results, draw in (
        ("pareto.png", sensitivity.lambdas, _draw_pareto),
        ("cases.png", sensitivity.others, _draw_cases),
    ):
        if results:
            figure = draw(sensitivity)
            write_whole(folder / name, lambda part, figure=figure: figure.savefig(part))  # type: ignore[misc]
            content[name] = (folder / name).read_bytes()
    paragraphs = [
        "Every case changes one thing. Thresholds, optima and policies are searched, fitted and trained in the changed"
        " scenario, on training people; unseen people play. Of phase errors and unusual styles training knows nothing."
        " A phase error is a model: an offset, drawn for each action from N(0, std^2), added to the estimator's phase."
    ]
    html = html_page(
        f"Sensitivity: {sensitivity.title}",
        paragraphs,
        command_line,
        tables(sensitivity),
        content,
        {name: ABOUT[name] for name in SHOWN},
        "a generator made these people, nobody was recorded.",
    )
    write_whole(folder / "index.html", lambda part: part.write_text(html, encoding="utf-8"))


def _write_csv(sensitivity: Sensitivity, path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        known = ["group", "value", "label", "phase_rmse", "policy"]
        writer.writerow([*known, "robot_idle", "human_idle", "cost", "cost_low", "cost_high"])
        for result in (*sensitivity.lambdas, *sensitivity.others):
            rmse = float(np.mean([r.phase_rmse["unseen"] for r in result.results]))
            for name in SHOWN:
                row, case = result.row(name), result.case
                idle = row.robot_idle_total, row.human_idle_total
                about = case.group, case.value, case.label, rmse, name
                writer.writerow([*about, *idle, row.cost, *row.cost_interval])


_COLOURS = dict(zip(SHOWN, ("black", "#999999", "#0072B2", "#D55E00", "#56B4E9", "#009E73"), strict=True))


def _draw_pareto(sensitivity: Sensitivity) -> "Figure":
    """Robot idle against human idle, a curve over lambda for each policy."""
    figure = new_figure(7.5, 4.8)
    ax = figure.subplots()
    for name in SHOWN:
        rows = [result.row(name) for result in sensitivity.lambdas]
        robot, human = [r.robot_idle_total for r in rows], [r.human_idle_total for r in rows]
        dash = "--" if name in (NO_PHASE, FITTED, PERFECT) else "-"
        ax.plot(human, robot, dash, marker="o", ms=4, color=_COLOURS[name], label=name)
    rows = [result.row(ppo_name("paper")) for result in sensitivity.lambdas]
    for result, row in zip(sensitivity.lambdas, rows, strict=True):
        ax.annotate(
            f"{result.case.value:g}", (row.human_idle_total, row.robot_idle_total), fontsize=8,
            xytext=(4, 4), textcoords="offset points", color=_COLOURS[ppo_name("paper")],
        )  # fmt: skip
    ax.set_xlabel("human idle [s]")
    ax.set_ylabel("robot idle [s]")
    ax.set_title(f"{sensitivity.title}: SYNTHETIC unseen people; numbers: lambda", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8)
    return figure


def _draw_cases(sensitivity: Sensitivity) -> "Figure":
    """Cost in every case."""
    figure = new_figure(9, 0.38 * len(sensitivity.others) + 1.6)
    ax = figure.subplots()
    at = np.arange(len(sensitivity.others))[::-1]
    for name, marker in zip(SHOWN, "|soD^*", strict=True):
        cost = [result.row(name).cost for result in sensitivity.others]
        # A stroke through what lies on it.
        size, order = (14, 3) if name == NO_PHASE else (7, 2)
        ax.plot(cost, at, marker, color=_COLOURS[name], ms=size, zorder=order, label=name)
    ax.set_yticks(at, [result.case.label for result in sensitivity.others])
    ax.set_xlabel("cost per episode [s]")
    ax.set_title(f"{sensitivity.title}: SYNTHETIC unseen people", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure
