"""Measured effect of every option of the alignment, on synthetic and on real people: ``python benchmarks/options.py``.

Each option changes one thing against OS-DTW_WP as tuned without any. Prints mean squared errors, means of the actions,
and what a pause of 5 s in the middle of an action does: how far the phase drifts, over the drift at nominal speed.
"""

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from pace_drake.demos.signals import ActionSignals, SignalSet, synthetic_signals, watch_signals
from pace_drake.dtw.estimator import Estimator
from pace_drake.dtw.gate import MovementGate
from pace_drake.dtw.monotone import Monotone
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.dtw.scores import mean_squared_error
from pace_drake.dtw.several import SeveralReferences
from pace_drake.dtw.tune import WP, Setting
from pace_drake.errors import InputError
from pace_drake.evaluate.tuning import Job, fused_estimator, run_jobs

PAUSE = 5.0  # [s]

Make = Callable[[ActionSignals, Setting], Estimator]


def alignment(action: ActionSignals, setting: Setting, reference: int | None = None, **options) -> OpenEndSoftDTW:
    """The tuned alignment, with other options or another reference."""
    return OpenEndSoftDTW(
        action.train[setting.reference if reference is None else reference].values,
        setting.gamma,
        setting.distance,
        setting.window,
        sample_period=action.train[0].sample_period,
        **options,
    )


def several(action: ActionSignals, setting: Setting) -> Estimator:
    """The tuned reference and those of two other people, of the lengths nearest to it."""
    own = action.train[setting.reference]
    others = {}
    for k, signal in enumerate(action.train):
        if signal.subject != own.subject:
            others.setdefault(signal.subject, k)
    nearest = sorted(others.values(), key=lambda k: abs(len(action.train[k].values) - len(own.values)))[:2]
    return SeveralReferences([alignment(action, setting, k) for k in (setting.reference, *nearest)])


def rate_limit(action: ActionSignals) -> float:
    """[1/s] Three times the rate of the fastest training signal."""
    period = action.train[0].sample_period
    return 3.0 / (min(len(signal.values) - 1 for signal in action.train) * period)


def gated_with_reference(action: ActionSignals, setting: Setting) -> Estimator:
    """A gate that takes the same rests out of the reference."""
    period = action.train[0].sample_period
    return MovementGate.of_reference(
        action.train[setting.reference].values,
        lambda moving: OpenEndSoftDTW(moving, setting.gamma, setting.distance, setting.window, sample_period=period),
        sample_period=period,
    )


OPTIONS: dict[str, Make] = {
    "as tuned": lambda action, setting: alignment(action, setting),
    # One distance stands for those of all axes, so that gamma is divided by their number.
    "pooled correlation": lambda action, setting: alignment(
        action, replace(setting, gamma=setting.gamma / action.train[0].values.shape[1]), pooled=True
    ),
    "asymmetric steps": lambda action, setting: alignment(action, setting, steps="asymmetric"),
    "symmetric2 steps, Tormene": lambda action, setting: alignment(
        action, setting, steps="symmetric2", normalization="steps"
    ),
    "argmin of R / max(i, j)": lambda action, setting: alignment(action, setting, normalization="max"),
    "monotone": lambda action, setting: Monotone(alignment(action, setting), None),
    "monotone, rate limit": lambda action, setting: Monotone(alignment(action, setting), rate_limit(action)),
    "movement gate": lambda action, setting: MovementGate(alignment(action, setting)),
    "movement gate, reference too": gated_with_reference,
    "three references": several,
}


def pause_drift(estimator: Estimator, values: np.ndarray, rng: np.random.Generator) -> float:
    """Drift of the phase over a pause in the middle, over what nominal speed would make of it.

    The hand rests with the noise of a tracker (1.5 mm).
    """
    half, num = len(values) // 2, round(PAUSE / estimator.sample_period)
    rest = values[half - 1] + rng.normal(0.0, 0.0015, (num, values.shape[1]))
    phases = estimator.phase(np.concatenate([values[:half], rest]))
    return float((phases[-1] - phases[half - 1]) / (num / (len(values) - 1)))


def measure(signals: SignalSet, console: Console) -> None:
    """Prints the table of one signal set."""
    tuned = run_jobs([Job(action, (WP,), 60, 0) for action in signals.actions], 2)
    table = Table(title=signals.description)
    columns = ["train", *(["held-out trials"] if signals.actions[0].heldout_trials else []), "held-out people"]
    for column in ("option", *(f"MSE {name}" for name in columns), f"drift in a pause of {PAUSE:g} s"):
        table.add_column(column, justify="left" if column == "option" else "right")
    rng = np.random.default_rng(0)
    makes = {**OPTIONS, "fused": None}
    for name, make in track(makes.items(), description=signals.title, console=console):
        if name.startswith("movement gate") and signals.units != "m":
            table.add_row(name, *["-"] * (len(columns) + 1))
            continue
        errors: dict[str, list[float]] = {column: [] for column in columns}
        drifts = []
        for action, found in zip(signals.actions, tuned, strict=True):
            estimator = fused_estimator(action, found) if make is None else make(action, found.setting)
            own = action.train[found.setting.reference]
            parts = {
                "train": [signal for signal in action.train if signal is not own],
                "held-out trials": action.heldout_trials,
                "held-out people": action.heldout_people,
            }
            for column in columns:
                phases = estimator.phases([signal.values for signal in parts[column]])
                errors[column].append(np.mean([mean_squared_error(z) for z in phases]))
            drifts += [pause_drift(estimator, signal.values, rng) for signal in action.heldout_people]
        drift = f"{np.mean(drifts):.2f}" if signals.units == "m" else "-"
        table.add_row(name, *(f"{np.mean(errors[column]):.4f}" for column in columns), drift)
    console.print(table)


def main() -> None:
    """Both sets."""
    console = Console()
    measure(synthetic_signals(), console)
    try:
        measure(watch_signals(), console)
    except InputError as error:
        sys.exit(f"{error}")


if __name__ == "__main__":
    main()
