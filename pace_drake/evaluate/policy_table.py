"""Table I and what belongs beside it: policies over worlds of people, as rows of means with intervals."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from pace_drake.evaluate.policies import PolicyResult, interval, summarize
from pace_drake.evaluate.worlds import CLAIRVOYANT, NO_PHASE, PERFECT, WorldResult

#: Table I of the paper: idle [s] of robot and human per joint action, and the cost. Other people, other data.
PAPER_TABLE_I = {
    "explicit query": ((0.0, 0.0, 0.0), (14.00, 11.28, 12.15), 112.3),
    "PACE without phase": ((1.56, 3.48, 11.64), (1.79, 1.02, 1.06), 28.29),
    "PACE": ((1.93, 2.65, 1.28), (1.20, 0.56, 2.56), 18.81),
}
PAPER_NOTE = "other people and other data"


@dataclass(frozen=True)
class Row:
    """One policy with one split of people, over all worlds.

    Attributes:
        policy, split: which.
        worlds: how many; means are over the worlds' means, and intervals of 95 % from how these differ. With one world
            they are over its episodes.
        robot_idle, human_idle: (L,) [s] per joint action; NaN where only the cost is known.
        robot_idle_total, human_idle_total, cost: [s].
        cost_interval: [s].
        saving: [s] against the first policy, on the same episodes; with its interval.
        cheaper: [%] than the exact optimum without phase, mean over worlds; cheaper_range: least and most of them.
        gap: [%] of the way from the optimum without phase to perfect phase, mean over worlds.
        decisions, time, robot_task_rate, robot_idle_share, human_idle_share, concurrent_share, delay_share, truncated:
            see ``PolicyResult``.
    """

    policy: str
    split: str
    worlds: int
    robot_idle: tuple[float, ...]
    human_idle: tuple[float, ...]
    robot_idle_total: float
    human_idle_total: float
    cost: float
    cost_interval: tuple[float, float]
    saving: float
    saving_interval: tuple[float, float]
    cheaper: float
    cheaper_range: tuple[float, float]
    gap: float
    decisions: float
    time: float
    robot_task_rate: float
    robot_idle_share: float
    human_idle_share: float
    concurrent_share: float
    delay_share: float
    truncated: float

    def to_json(self) -> dict[str, Any]:
        """Plain data; what is not known is None."""
        return {name: _plain(value) for name, value in asdict(self).items()}


_MEANS = tuple(
    field.name
    for field in fields(Row)
    if field.name in {f.name for f in fields(PolicyResult)}
    and field.name not in ("policy", "cost", "cost_interval", "saving", "saving_interval")
)


def rows_of(results: Sequence[WorldResult], split: str) -> list[Row]:
    """A row for every policy, and one for the clairvoyant.

    Args:
        results: of at least one world, all with the same policies.
        split: of the people.
    """
    names = list(results[0].played[split])
    base = np.array([r.played[split][NO_PHASE].cost.mean() for r in results]) if NO_PHASE in names else None
    perfect = np.array([r.played[split][PERFECT].cost.mean() for r in results]) if PERFECT in names else None
    rows = []
    for name in names:
        each = [summarize(name, r.played[split][name], next(iter(r.played[split].values()))) for r in results]
        cost, saving = (np.array([getattr(one, key) for one in each]) for key in ("cost", "saving"))
        means: dict[str, Any] = {key: _mean([getattr(one, key) for one in each]) for key in _MEANS}
        rows.append(
            Row(
                policy=name,
                split=split,
                worlds=len(results),
                robot_idle_total=sum(means["robot_idle"]),
                human_idle_total=sum(means["human_idle"]),
                cost=float(cost.mean()),
                cost_interval=interval(cost) if len(cost) > 1 else each[0].cost_interval,
                saving=float(saving.mean()),
                saving_interval=interval(saving) if len(cost) > 1 else each[0].saving_interval,
                **_compared(cost, base, perfect),
                **means,
            )
        )
    cost = np.array([r.clairvoyant[split].mean() for r in results])
    nothing = float("nan")
    unknown: dict[str, Any] = dict.fromkeys(set(_MEANS) - {"robot_idle", "human_idle"}, nothing)
    joints = len(rows[0].robot_idle)
    rows.append(
        Row(
            policy=CLAIRVOYANT,
            split=split,
            worlds=len(results),
            robot_idle=(nothing,) * joints,
            human_idle=(nothing,) * joints,
            robot_idle_total=nothing,
            human_idle_total=nothing,
            cost=float(cost.mean()),
            cost_interval=interval(cost if len(cost) > 1 else results[0].clairvoyant[split]),
            saving=nothing,
            saving_interval=(nothing, nothing),
            **_compared(cost, base, perfect),
            **unknown,
        )
    )
    return rows


def _compared(cost: np.ndarray, base: np.ndarray | None, perfect: np.ndarray | None) -> dict[str, Any]:
    nan = float("nan")
    if base is None:
        return {"cheaper": nan, "cheaper_range": (nan, nan), "gap": nan}
    cheaper = 100 * (1 - cost / base)
    return {
        "cheaper": float(cheaper.mean()),
        "cheaper_range": (float(cheaper.min()), float(cheaper.max())),
        "gap": nan if perfect is None else float((100 * (base - cost) / (base - perfect)).mean()),
    }


def _mean(values: Sequence[Any]) -> Any:
    mean = np.mean(values, axis=0)
    return tuple(mean.tolist()) if mean.ndim else float(mean)


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
