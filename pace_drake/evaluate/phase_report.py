"""The comparison of phase estimators on paper: tables, figures, and one HTML page that needs nothing else."""

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pace_drake.dtw.scores import FRACTIONS, Score, linear_phase
from pace_drake.dtw.tune import EU, OE, WP
from pace_drake.evaluate.phase import (
    CONSTANT,
    DERIVATIVE,
    ESTIMATORS,
    FUSED,
    PAPER_ACTIONS,
    PAPER_TABLE_II,
    PARTS,
    PROMP,
    TIME,
    Evaluation,
    example,
)
from pace_drake.evaluate.report import Table, html_page, new_figure
from pace_drake.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: What each estimator is.
ABOUT = {
    CONSTANT: "Always one half: what knowing nothing gets.",
    TIME: "Elapsed time over the mean duration of the training signals; it looks at no motion.",
    OE: "Open-end DTW with the Euclidean distance and the hard minimum; only its reference is chosen.",
    EU: "Open-end soft-DTW with the Euclidean distance, smoothing tuned.",
    DERIVATIVE: "Open-end DTW on the slopes of the signals, with the reference of OS-DTW_WP.",
    PROMP: "Posterior over durations from a probabilistic movement primitive (Maeda et al. 2017).",
    WP: "The paper's: open-end soft-DTW with the Windowed-Pearson distance, smoothing and window tuned.",
    FUSED: "OS-DTW_WP and the distribution of durations in one Bayesian filter.",
}
PART_NAMES = dict(zip(PARTS, ("train", "held-out trials", "held-out people"), strict=True))
PAPER_NOTE = "the paper, on its own data, not comparable"

# Colours of Okabe and Ito, which colour-blind people can tell apart; the dashes differ as well.
_STYLES = {
    TIME: ("#999999", (0, (1, 1))),
    OE: ("#E69F00", (0, (5, 1, 1, 1))),
    EU: ("#CC79A7", (0, (4, 1))),
    WP: ("#0072B2", "solid"),
    FUSED: ("#009E73", "solid"),
    DERIVATIVE: ("#D55E00", (0, (3, 1, 1, 1, 1, 1))),
    PROMP: ("#56B4E9", (0, (6, 2))),
}
_PART_COLOURS = ("#999999", "#E69F00", "#0072B2")
_MAIN = (TIME, OE, EU, WP, FUSED)  # in the figure of the phases


def tables(evaluation: Evaluation) -> list[Table]:
    """The phase, the remaining time, the actions one by one, and the paper's Table II."""
    part = evaluation.part
    on_people = PART_NAMES[part]
    phase_rows, time_rows = [], []
    for name in ESTIMATORS:
        one = evaluation.mean(name, part)
        latency = evaluation.latency[name]
        if one is None:
            continue
        mse = [_mse(evaluation.mean(name, each)) for each in PARTS]
        delays = [f"{1e6 * value:.0f}" for value in (latency.p50, latency.p99)]
        phase_rows.append([name, *mse, f"{one.bias:+.3f}", f"{100 * one.back_jumps:.1f}", *delays])
        times = [f"{error:.2f}" for error in one.remaining_time_error]
        time_rows.append([name, *times, "-" if math.isnan(one.coverage) else f"{100 * one.coverage:.0f}"])
    action_rows = [
        [name, *(_mse(of_action[name][part]) for of_action in evaluation.scores.values())] for name in ESTIMATORS
    ]
    paper_rows = [[name, *(f"{value:.3f}" for value in values)] for name, values in PAPER_TABLE_II.items()]
    what = "SYNTHETIC data, mean of the actions" if evaluation.signals.synthetic else "mean of the actions"
    percents = [f"at {fraction:.0%}\n[s]" for fraction in FRACTIONS]
    return [
        Table(
            f"Phase, {what}\n(bias and back-jumps: {on_people})",
            [
                "",
                "MSE\ntrain",
                "MSE\nheld-out\ntrials",
                "MSE\nheld-out\npeople",
                "bias",
                "back-jumps\n[%]",
                "p50\n[us]",
                "p99\n[us]",
            ],
            phase_rows,
        ),
        Table(
            f"Error of the remaining time, {what}, {on_people}",
            ["", *percents, "90 % intervals\nthat hold [%]"],
            time_rows,
        ),
        Table(f"MSE of the phase on {on_people}, by action", ["", *evaluation.scores], action_rows),
        Table(f"Table II of the paper, MSE: {PAPER_NOTE}", ["", *PAPER_ACTIONS], paper_rows),
    ]


def _mse(score: Score | None) -> str:
    return "-" if score is None else f"{score.mse:.4f}"


def write_report(folder: Path, evaluation: Evaluation, command_line: str) -> None:
    """Writes scores.csv, fig7.png, errors.png and index.html into an existing folder.

    Args:
        folder: where.
        evaluation: what to report.
        command_line: what repeats it, for the page.
    """
    write_whole(folder / "scores.csv", lambda part: write_scores(part, evaluation))
    write_whole(folder / "fig7.png", lambda part: draw_phases(part, evaluation))
    write_whole(folder / "errors.png", lambda part: draw_errors(part, evaluation))
    pictures = {name: (folder / name).read_bytes() for name in ("fig7.png", "errors.png")}
    html = page(evaluation, command_line, pictures)
    write_whole(folder / "index.html", lambda part: part.write_text(html, encoding="utf-8"))


def write_scores(path: Path, evaluation: Evaluation) -> None:
    """Writes a CSV file: one row per action, estimator and part; empty where there is no value."""
    rows = evaluation.rows()
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            writer.writerow({k: "" if isinstance(v, float) and math.isnan(v) else v for k, v in row.items()})


def draw_phases(path: Path, evaluation: Evaluation) -> None:
    """Draws one held-out signal of each action, and the phases that the main estimators give for it (Fig. 7)."""
    from matplotlib import colormaps

    num = len(evaluation.fitted)
    figure = new_figure(11.0, 2.1 * num + 1.2)
    axes = figure.subplots(num, 2, squeeze=False, width_ratios=(2, 3))
    for one, (left, right) in zip(evaluation.fitted, axes, strict=True):
        signal, estimates = example(one)
        time = np.arange(len(signal.values)) * signal.sample_period
        num_axes = signal.values.shape[1]
        for k, axis in enumerate(signal.values.T):
            left.plot(time, axis, linewidth=0.8, color=colormaps["cividis"](0.9 * k / max(num_axes - 1, 1)))
        left.set_ylabel(f"{signal.action}\n{signal.subject}, {signal.trial}", fontsize=9)
        right.plot(time, linear_phase(len(time)), color="black", linewidth=1.2, linestyle=(0, (6, 4)), label="truth")
        for name in _MAIN:
            colour, dashes = _STYLES[name]
            phase, std = np.asarray(estimates[name].phase), np.asarray(estimates[name].phase_std)
            right.plot(time, phase, color=colour, linestyle=dashes, linewidth=1.5, label=name)
            if name == FUSED:
                low, high = np.clip((phase - std, phase + std), 0.0, 1.0)
                right.fill_between(time, low, high, color=colour, alpha=0.25, linewidth=0, label="fused, +-1 std")
        right.set_ylim(-0.03, 1.03)
        right.set_xlim(0.0, time[-1])
        left.set_xlim(0.0, time[-1])
        right.set_ylabel("phase", fontsize=9)
        for ax in (left, right):
            ax.tick_params(labelsize=8)
            ax.grid(alpha=0.3)
    axes[0, 0].set_title(f"signal [{evaluation.signals.units}]\naxes from dark to bright", fontsize=9)
    axes[0, 1].set_title("phase as it was estimated at each moment", fontsize=9)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]", fontsize=9)
    handles, labels = axes[0, 1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
    _save(figure, path, evaluation, "one held-out signal of each action")


def draw_errors(path: Path, evaluation: Evaluation) -> None:
    """Draws the phase's errors by part, and the remaining time's error by fraction of the action."""
    figure = new_figure(11.0, 4.4)
    dots, lines = figure.subplots(1, 2)
    for part, colour, marker in zip(PARTS, _PART_COLOURS, "so^", strict=True):
        means = [evaluation.mean(name, part) for name in ESTIMATORS]
        if any(means):
            errors = [one.mse if one else math.nan for one in means]
            dots.plot(errors, range(len(errors)), marker, color=colour, markersize=7, label=PART_NAMES[part])
    dots.set_yticks(range(len(ESTIMATORS)), ESTIMATORS)
    dots.invert_yaxis()
    dots.set_xscale("log")
    dots.set_xlabel("mean squared error of the phase")
    for name in ESTIMATORS:
        one = evaluation.mean(name, evaluation.part)
        if name == CONSTANT or one is None:
            continue
        colour, dashes = _STYLES[name]
        percents = [100 * fraction for fraction in FRACTIONS]
        lines.plot(
            percents, one.remaining_time_error, color=colour, linestyle=dashes, marker="o", markersize=4, label=name
        )
    lines.set_yscale("log")
    lines.yaxis.set_major_formatter("{x:g}")
    lines.set_xticks([100 * fraction for fraction in FRACTIONS])
    lines.set_xlabel("part of the action that has passed [%]")
    lines.set_ylabel("error of the remaining time [s]")
    lines.set_title(PART_NAMES[evaluation.part], fontsize=9)
    for ax in (dots, lines):
        ax.grid(alpha=0.3, which="both")
    dots.legend(fontsize=8)
    lines.legend(fontsize=8, handlelength=4, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    _save(figure, path, evaluation, "mean of the actions")


def _save(figure: "Figure", path: Path, evaluation: Evaluation, what: str) -> None:
    label = "SYNTHETIC " * evaluation.signals.synthetic
    figure.suptitle(f"{label}{evaluation.signals.title}: {what}", fontsize=11)
    figure.savefig(path)


def page(evaluation: Evaluation, command_line: str, pictures: dict[str, bytes]) -> str:
    """The whole report as one HTML page, pictures (name -> PNG) within it."""
    signals = evaluation.signals
    return html_page(
        f"Phase estimators on {signals.title}",
        [
            f"{signals.description}.",
            f"Source: {signals.source}. Licence: {signals.licence}. Units: {signals.units}.",
            _METHOD,
        ],
        command_line,
        tables(evaluation),
        pictures,
        ABOUT,
        "a generator made these signals, no person did." if signals.synthetic else "",
    )


_METHOD = """The truth is a linear phase (paper, Sec. IV-A). Everything is tuned and fitted on the training signals \
alone; a reference is not scored on itself. An estimator without a prediction of its own has its remaining time \
extrapolated: elapsed (1 - phase) / phase. p50 and p99 are wall times of one update."""
