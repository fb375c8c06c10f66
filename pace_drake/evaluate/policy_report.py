"""The comparison of policies on paper: tables, figures, CSV, JSON, and one HTML page."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from pace_drake.evaluate.participants import NUM_PARTICIPANTS, NUM_TRIALS, SIZES, Participants, Study
from pace_drake.evaluate.policy_table import PAPER_NOTE, PAPER_TABLE_I, Row, rows_of
from pace_drake.evaluate.report import Table, html_page, new_figure
from pace_drake.evaluate.worlds import (
    CLAIRVOYANT,
    EXPLICIT,
    FITTED,
    NO_PHASE,
    PERFECT,
    WorldResult,
    ppo_name,
)
from pace_drake.files import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SPLIT_NAMES = {
    "train": "training people and trials",
    "validation": "training people, validation trials",
    "unseen": "unseen people",
    "recorded": "recorded hands",
}
#: What each row is.
ABOUT = {
    EXPLICIT: "Assists when the person asks, which they do once they wait.",
    "always assist": "Assists at every decision.",
    "never assist": "Never assists, so episodes are cut off.",
    "elapsed threshold": "Assists once an action has lasted for so long; the best such times.",
    NO_PHASE: "The exact optimum of all policies that see robot task, human action and elapsed time (value iteration).",
    "phase threshold": "Assists from a phase on; the best such phases.",
    "remaining time threshold": "Assists once elapsed (1 - phase) / phase is small enough; the best such times.",
    FITTED: "About the best policy on action, elapsed time and phase, by regression over simulated paths.",
    ppo_name("none"): "Learned, sees what the exact optimum sees.",
    ppo_name("paper"): "Learned, sees the paper's observation: robot task, human action, elapsed time, phase.",
    ppo_name("fused"): "Learned, sees the phase filter's mean and deviation and the remaining time.",
    ppo_name("history"): "Learned, sees the same and this person's pace so far; not in the paper.",
    PERFECT: "Knows when the person will be ready, but not how long the robot takes.",
    CLAIRVOYANT: "Knows all durations beforehand: the physical limit.",
}
#: Methods of the simulated study with participants, as far as they were played.
STUDIED = (EXPLICIT, ppo_name("none"), ppo_name("paper"), ppo_name("history"))
_STUDIES = 400


@dataclass(frozen=True)
class Comparison:
    """All that a report is made of.

    Attributes:
        title: names the scenario.
        people: a line about the people.
        synthetic: whether they are.
        results: one per world.
        seed: of the simulated studies.
        human_cv: [-] of the drawn durations of the non-joint actions.
    """

    title: str
    people: str
    synthetic: bool
    results: Sequence[WorldResult]
    seed: int
    human_cv: tuple[float, ...]

    @property
    def splits(self) -> tuple[str, ...]:
        """Of the people."""
        return tuple(self.results[0].played)

    @property
    def main(self) -> str:
        """The split that counts: people whom nothing was learnt from, where there are some."""
        return "unseen" if "unseen" in self.splits else self.splits[-1]

    def rows(self, split: str | None = None) -> list[Row]:
        """Of one split; None: the main one."""
        return rows_of(self.results, split or self.main)

    def participants(self) -> Participants | None:
        """The people of the main split in all worlds; None where fewer than two methods were played."""
        methods = [name for name in STUDIED if name in self.results[0].played[self.main]]
        if len(methods) < 2:
            return None
        offsets = np.cumsum([0, *(r.person[self.main].max() + 1 for r in self.results)])
        person = np.concatenate([r.person[self.main] + o for r, o in zip(self.results, offsets, strict=False)])
        costs = {m: np.concatenate([r.played[self.main][m].cost for r in self.results]) for m in methods}
        return Participants(costs, person)


@dataclass(frozen=True)
class Power:
    """Share of simulated studies with p < 0.05, by number of participants."""

    first: str
    second: str
    sizes: tuple[int, ...]
    shares: tuple[float, ...]


def studies(comparison: Comparison) -> tuple[Study | None, list[Power]]:
    """One study as large as the paper's, and the power of the comparisons with the policy without phase."""
    people = comparison.participants()
    if people is None:
        return None, []
    study = people.study(NUM_PARTICIPANTS, NUM_TRIALS, np.random.default_rng([comparison.seed, 1]))
    first = ppo_name("none") if ppo_name("none") in people.costs else next(iter(people.costs))
    powers = []
    for second in people.costs:
        if second in (first, EXPLICIT):
            continue
        rng = np.random.default_rng([comparison.seed, 2])
        shares = tuple(people.power(first, second, size, NUM_TRIALS, _STUDIES, rng) for size in SIZES)
        powers.append(Power(first, second, SIZES, shares))
    return study, powers


def tables(comparison: Comparison, study: Study | None, powers: Sequence[Power]) -> list[Table]:
    """Table I, the other splits, fluency, the worlds one by one, and the simulated study."""
    worlds = len(comparison.results)
    what = "SYNTHETIC people, " if comparison.synthetic else ""
    over = f"mean of {worlds} worlds" if worlds > 1 else "one world"
    found = [
        _idle(comparison, f"Table I: {what}{SPLIT_NAMES[comparison.main]}, {over}"),
        _compared(comparison, f"Cost, compared: {what}{SPLIT_NAMES[comparison.main]}, {over}"),
    ]
    if len(comparison.splits) > 1:
        found.append(_costs(comparison, f"Cost by people [s]: {what}{over}"))
    found.append(_fluency(comparison, f"Fluency: {what}{SPLIT_NAMES[comparison.main]}, {over}"))
    if worlds > 1:
        found.append(_worlds(comparison, f"Cost in each world [s]: {what}{SPLIT_NAMES[comparison.main]}"))
    if study is not None:
        found.append(_study(study, comparison))
    if powers:
        rows = [[f"{p.second}, against {p.first}", *(f"{100 * share:.0f}" for share in p.shares)] for p in powers]
        title = f"Power: simulated studies with p < 0.05 [%], {what}{NUM_TRIALS} trials each, {_STUDIES} studies"
        found.append(Table(title, ["", *(f"{size} people" for size in SIZES)], rows))
    return found


def _idle(comparison: Comparison, title: str) -> Table:
    body = [[row.policy, _sum(row.robot_idle), _sum(row.human_idle), f"{row.cost:.2f}"] for row in comparison.rows()]
    body += [
        [f"{name} (paper)", _sum(robot), _sum(human), f"{cost:.2f}"]
        for name, (robot, human, cost) in PAPER_TABLE_I.items()
    ]
    idle = "/".join(f"A{k + 1}" for k in range(len(comparison.rows()[0].robot_idle)))
    columns = ["", f"robot idle [s]\n{idle} = total", f"human idle [s]\n{idle} = total", "cost\n[s]"]
    return Table(f"{title}; (paper): {PAPER_NOTE}", columns, body)


def _compared(comparison: Comparison, title: str) -> Table:
    body = [
        [
            row.policy,
            f"{row.cost:.2f}",
            f"±{_half(row.cost_interval):.2f}",
            "-" if np.isnan(row.cheaper) or row.policy == "never assist" else f"{row.cheaper:.1f}",
            "-" if np.isnan(row.gap) or row.policy == "never assist" else f"{row.gap:.0f}",
        ]
        for row in comparison.rows()
    ]
    return Table(title, ["", "cost\n[s]", "95 %", "cheaper than\nno phase [%]", "gap\nclosed [%]"], body)


def _sum(values: Sequence[float]) -> str:
    if np.isnan(values[0]):
        return "-"
    return f"{'/'.join(f'{v:.2f}' for v in values)} = {sum(values):.2f}"


def _costs(comparison: Comparison, title: str) -> Table:
    of = {split: {row.policy: row for row in comparison.rows(split)} for split in comparison.splits}
    names = [name for name in of[comparison.main] if name != "never assist"]
    body = [
        [name, *(f"{of[s][name].cost:.2f} ±{_half(of[s][name].cost_interval):.2f}" for s in comparison.splits)]
        for name in names
    ]
    rmse = [f"{np.mean([r.phase_rmse[s] for r in comparison.results]):.3f}" for s in comparison.splits]
    body.append(["phase error, rms", *rmse])
    return Table(title, ["", *(fill(SPLIT_NAMES[s], 18) for s in comparison.splits)], body)


def _half(bounds: tuple[float, float]) -> float:
    return (bounds[1] - bounds[0]) / 2


def _fluency(comparison: Comparison, title: str) -> Table:
    body = [
        [
            row.policy,
            *(f"{v:.1f}" for v in (row.robot_idle_share, row.human_idle_share, row.concurrent_share, row.delay_share)),
            f"{row.time:.1f}",
            f"{row.robot_task_rate:.2f}",
            f"{row.decisions:.1f}",
            f"{100 * row.truncated:.0f}",
        ]
        for row in comparison.rows()
        if row.policy != CLAIRVOYANT
    ]
    columns = [
        "",
        "R-IDLE\n[%]",
        "H-IDLE\n[%]",
        "C-ACT\n[%]",
        "F-DEL\n[%]",
        "task\ntime\n[s]",
        "robot\ntasks\n[1/min]",
        "decisions",
        "cut\noff\n[%]",
    ]
    return Table(title, columns, body)


def _worlds(comparison: Comparison, title: str) -> Table:
    split = comparison.main
    names = [name for name in comparison.results[0].played[split] if name not in ("never assist", "always assist")]
    body = [
        [name, *(f"{r.played[split][name].cost.mean():.2f}" for r in comparison.results)]
        for name in names
        if name != EXPLICIT
    ]
    body.append(["phase error, rms", *(f"{r.phase_rmse[split]:.3f}" for r in comparison.results)])
    return Table(title, ["", *(f"world\n{r.seed}" for r in comparison.results)], body)


def _study(study: Study, comparison: Comparison) -> Table:
    body = [
        [
            f"{pair.first} - {pair.second}",
            f"{pair.difference:.2f}",
            f"{pair.p:.4f}",
            f"{pair.p_holm:.4f}",
            f"{pair.effect:+.2f}",
        ]
        for pair in study.pairs
    ]
    friedman = "" if np.isnan(study.friedman_p) else f"; Friedman p = {study.friedman_p:.2g}"
    what = "SYNTHETIC people: " * comparison.synthetic
    title = f"A study, simulated; {what}{study.participants} participants x {study.trials} trials{friedman}"
    return Table(title, ["", "difference\n[s]", "p, exact\nWilcoxon", "p, Holm", "rank-biserial\neffect"], body)


def to_json(comparison: Comparison, study: Study | None, powers: Sequence[Power]) -> dict[str, Any]:
    """All figures: per split and policy, and of the simulated study."""
    from dataclasses import asdict

    return {
        "title": comparison.title,
        "people": comparison.people,
        "synthetic": comparison.synthetic,
        "worlds": [r.seed for r in comparison.results],
        "episodes": len(comparison.results[0].clairvoyant[comparison.main]),
        "human_cv": list(comparison.human_cv),
        "phase_rmse": {s: float(np.mean([r.phase_rmse[s] for r in comparison.results])) for s in comparison.splits},
        "splits": {split: {row.policy: row.to_json() for row in comparison.rows(split)} for split in comparison.splits},
        "paper": {
            name: {
                "robot_idle": list(robot),
                "human_idle": list(human),
                "cost": cost,
                "note": f"the paper, {PAPER_NOTE}",
            }
            for name, (robot, human, cost) in PAPER_TABLE_I.items()
        },
        "study": None
        if study is None
        else {**asdict(study), "friedman_p": None if np.isnan(study.friedman_p) else study.friedman_p},
        "power": [asdict(power) for power in powers],
    }


def write_report(
    folder: Path, comparison: Comparison, study: Study | None, powers: Sequence[Power], command_line: str
) -> None:
    """Writes policies.csv, idle.png, worlds.png (where there are several) and index.html into a folder."""
    write_whole(folder / "policies.csv", lambda part: _write_csv(comparison, part))
    pictures: dict[str, Any] = {"idle.png": _draw_idle}
    if len(comparison.results) > 1:
        pictures["worlds.png"] = _draw_worlds
    content: dict[str, bytes] = {}
    for name, draw in pictures.items():
        figure = draw(comparison)
        write_whole(folder / name, lambda part, figure=figure: figure.savefig(part))  # type: ignore[misc]
        content[name] = (folder / name).read_bytes()
    paragraphs = [
        comparison.people,
        f"Human durations have a coefficient of variation of {_cv(comparison.human_cv)}; the phase error (root mean"
        " square, over all samples) stands under the costs. In every world references, calibrations, thresholds and"
        " policies come from the training trials of five people alone; all policies play the same episodes.",
        "cost = robot idle + lambda x human idle. Intervals of 95 % are from how the worlds differ, or, with one world,"
        " its episodes. Gap closed: of the way from the exact optimum without phase to perfect phase. A learned policy"
        " always assists a person who waits; that guard is part of it. R-IDLE, H-IDLE: share of the time for which the"
        " robot, the person waits; C-ACT: both act; F-DEL: one waits for the other.",
    ]
    html = html_page(
        f"Policies: {comparison.title}",
        paragraphs,
        command_line,
        tables(comparison, study, powers),
        content,
        {name: text for name, text in ABOUT.items() if name in {row.policy for row in comparison.rows()}},
        "a generator made these people, nobody was recorded." if comparison.synthetic else "",
    )
    write_whole(folder / "index.html", lambda part: part.write_text(html, encoding="utf-8"))


def _cv(values: Sequence[float]) -> str:
    return " / ".join(f"{v:g}" for v in dict.fromkeys(values))


def _write_csv(comparison: Comparison, path: Path) -> None:
    rows = [row.to_json() for split in comparison.splits for row in comparison.rows(split)]
    flat = []
    for row in rows:
        out: dict[str, Any] = {}
        for key, value in row.items():
            if key in ("cost_interval", "saving_interval", "cheaper_range"):
                out |= {f"{key}_low": value[0], f"{key}_high": value[1]}
            elif isinstance(value, list):
                out |= {f"{key}_{k + 1}": one for k, one in enumerate(value)}
            else:
                out[key] = value
        flat.append(out)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(flat[0]))
        writer.writeheader()
        writer.writerows(flat)


def _label(comparison: Comparison) -> str:
    return f"{'SYNTHETIC people, ' * comparison.synthetic}{SPLIT_NAMES[comparison.main]}"


def _draw_idle(comparison: Comparison) -> "Figure":
    """Cost of each policy, as robot idle and weighted human idle."""
    rows = [row for row in comparison.rows() if row.policy not in ("never assist", EXPLICIT, CLAIRVOYANT)]
    figure = new_figure(9, 0.42 * len(rows) + 1.6)
    ax = figure.subplots()
    at = np.arange(len(rows))[::-1]
    robot = np.array([row.robot_idle_total for row in rows])
    cost = np.array([row.cost for row in rows])
    ax.barh(at, robot, color="#0072B2", label="robot idle")
    ax.barh(at, cost - robot, left=robot, color="#E69F00", label="lambda x human idle")
    half = [_half(row.cost_interval) for row in rows]
    ax.errorbar(cost, at, xerr=half, fmt="none", color="black", lw=1, capsize=3, label="95 % interval of the cost")
    for y, c in zip(at, cost, strict=True):
        ax.text(c + max(half) + 0.4, y, f"{c:.1f}", va="center", fontsize=8)
    limit = next(row.cost for row in comparison.rows() if row.policy == CLAIRVOYANT)
    ax.axvline(limit, color="0.4", lw=1, ls=":", label=f"least possible, {limit:.1f}")
    ax.set_yticks(at, [row.policy for row in rows])
    ax.set_xlim(0, 1.1 * cost.max())
    ax.set_xlabel("cost per episode [s]")
    ax.set_title(f"{comparison.title}: {_label(comparison)}", fontsize=10)
    left_out = next((row.cost for row in comparison.rows() if row.policy == EXPLICIT), None)
    title = None if left_out is None else f"not shown: {EXPLICIT}, {left_out:.1f}"
    ax.legend(title=title, title_fontsize=8, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure


def _draw_worlds(comparison: Comparison) -> "Figure":
    """How much cheaper than the optimum without phase each learned policy is, world by world."""
    split = comparison.main
    names = [
        name
        for name in ("remaining time threshold", FITTED, *(ppo_name(o) for o in ("paper", "fused", "history")), PERFECT)
        if name in comparison.results[0].played[split]
    ]
    figure = new_figure(9, 3.6)
    ax = figure.subplots()
    markers = dict(zip(names, "vsoD^*", strict=False))
    colours = ("#999999", "#56B4E9", "#0072B2", "#CC79A7", "#D55E00", "#009E73")
    for k, name in enumerate(names):
        saved = [
            100 * (1 - r.played[split][name].cost.mean() / r.played[split][NO_PHASE].cost.mean())
            for r in comparison.results
        ]
        # Side by side, as many are nearly equal.
        at = np.arange(len(saved)) + 0.1 * (k - (len(names) - 1) / 2)
        ax.plot(at, saved, markers[name], color=colours[k], label=f"{name}, mean {np.mean(saved):.1f}")
    ax.set_xticks(range(len(comparison.results)), [f"world {r.seed}" for r in comparison.results])
    ax.set_ylabel("cheaper than the\noptimum without phase [%]")
    ax.set_title(f"{comparison.title}: {_label(comparison)}", fontsize=10)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    return figure
