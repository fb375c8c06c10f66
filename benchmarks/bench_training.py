"""How long from the start of a process until PPO is within 2 % of the best: ``python benchmarks/bench_training.py``.

A fresh process imports everything, loads or makes the pool of phases, and trains with the default settings for
150,000 decisions; after every few updates the greedy policy plays 2,000 episodes of training people, off the clock. The
best is the default training of 300,000 decisions. With an empty cache the pool is made, and the kernel compiled; where
numba's is empty, too, as after an installation, the estimators' kernels are compiled as well.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

STEPS, EVERY = 150_000, 4


def child() -> None:
    """Prints a JSON list of [seconds since the process began, cost]."""
    began = float(os.environ["BENCH_BEGAN"])
    from dataclasses import replace

    import numpy as np
    from stable_baselines3.common.callbacks import BaseCallback

    from pace_drake.envs.pool import cached_pool
    from pace_drake.envs.twin import AssemblyTwin
    from pace_drake.evaluate.play import play
    from pace_drake.learning.greedy import GreedyPolicy
    from pace_drake.learning.ppo import TWIN_SETTINGS, train_ppo
    from pace_drake.people import load_people
    from pace_drake.scenario import load_scenario

    scenario = load_scenario("ikea_chair", ("human.split=train",))
    rows: list[list[float]] = []
    off_the_clock = 0.0

    class Watch(BaseCallback):
        updates = 0

        def _on_rollout_start(self) -> None:
            nonlocal off_the_clock
            self.updates += 1
            if self.updates % EVERY == 1 and self.updates > 1:
                now = perf_counter()
                pool = cached_pool(scenario, load_people(scenario), 512, 77)
                parts = pool.sample(2000, np.random.default_rng(0))
                twin = AssemblyTwin(scenario, pool, 2000)
                cost = play(twin, parts, GreedyPolicy(self.model, scenario)).cost.mean()
                rows.append([now - began - off_the_clock, float(cost)])
                off_the_clock += perf_counter() - now

        def _on_step(self) -> bool:
            return True

    steps = int(sys.argv[2])
    train_ppo(scenario, replace(TWIN_SETTINGS, steps=steps), backend="twin", callbacks=[watch := Watch()])
    watch.updates = EVERY
    watch._on_rollout_start()
    print(json.dumps(rows))


def run(steps: int, cache: Path | None, numba_cache: str | None = None) -> list[list[float]]:
    environment = dict(os.environ, BENCH_BEGAN=repr(perf_counter()))
    if cache is not None:
        environment["XDG_CACHE_HOME"] = str(cache)
    if numba_cache is not None:
        environment["NUMBA_CACHE_DIR"] = numba_cache
    command = [sys.executable, __file__, "child", str(steps)]
    return json.loads(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)


def main() -> None:
    from rich.console import Console
    from rich.table import Table

    best = run(300_000, None)[-1][1]
    table = Table("cache", "until within 2 % [s]", "cost then [s]", "cost after all [s]", title=f"best {best:.2f} s")
    with tempfile.TemporaryDirectory() as folder:
        cold = Path(folder)
        for name, cache in (("empty", cold), ("kernel and pool cached", cold), ("likewise", cold)):
            rows = run(STEPS, cache)
            first = next(row for row in rows if row[1] <= 1.02 * best)
            table.add_row(name, f"{first[0]:.1f}", f"{first[1]:.2f}", f"{rows[-1][1]:.2f}")
        for file in (cold / "pace_drake" / "pools").iterdir():
            file.unlink()
        rows = run(STEPS, cold)
        first = next(row for row in rows if row[1] <= 1.02 * best)
        table.add_row("kernel cached, pool made", f"{first[0]:.1f}", f"{first[1]:.2f}", f"{rows[-1][1]:.2f}")
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as numba_cache:
        rows = run(STEPS, Path(folder), numba_cache)
        first = next(row for row in rows if row[1] <= 1.02 * best)
        table.add_row("empty, and numba's, too", f"{first[0]:.1f}", f"{first[1]:.2f}", f"{rows[-1][1]:.2f}")
    Console().print(table)


if __name__ == "__main__":
    child() if sys.argv[1:2] == ["child"] else main()
