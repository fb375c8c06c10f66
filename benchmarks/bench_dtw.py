"""Times open-end soft-DTW beside other libraries, on the same arrays in one run: ``python benchmarks/bench_dtw.py``.

Rounds take turns, so that a machine that is busy for a while is so for all. "best" is the least of all rounds; ratios
are those of best times. Libraries that are not installed are left out, and named.
"""

import importlib
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from hashlib import sha256
from time import perf_counter

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from pace_drake.dtw import Distance, OpenEndSoftDTW

QUERY, REFERENCE, AXES = 600, 550, 3  # samples: a minute at 10 Hz
PERIOD = 0.1  # [s]
GAMMA = 1.0
ROUNDS = 60

Run = Callable[[], object]


def walk(rng: np.random.Generator, num_samples: int) -> NDArray:
    """A random walk (num_samples, AXES)."""
    return np.cumsum(rng.normal(size=(num_samples, AXES)), axis=0)


def in_turns(runs: dict[str, Run], rounds: int = ROUNDS) -> dict[str, NDArray]:
    """Seconds (rounds,) of each run, after one that is not counted: it may compile."""
    for run in runs.values():
        run()
    seconds = {name: np.empty(rounds) for name in runs}
    for k in range(rounds):
        for name, run in runs.items():
            start = perf_counter()
            run()
            seconds[name][k] = perf_counter() - start
    return seconds


def others(query: NDArray, reference: NDArray) -> Iterator[tuple[str, str, Callable[[], Run]]]:
    """(library, what it computes, what makes the run)."""

    def tslearn() -> Run:
        soft_dtw = importlib.import_module("tslearn.metrics").soft_dtw
        importlib.import_module("threadpoolctl").threadpool_limits(1)  # of its matrix product; came with it
        return lambda: soft_dtw(query, reference, gamma=GAMMA)

    def dtaidistance() -> Run:
        distance_fast = importlib.import_module("dtaidistance.dtw_ndim").distance_fast
        return lambda: distance_fast(query, reference)

    def dtw_python() -> Run:
        dtw = importlib.import_module("dtw").dtw
        return lambda: dtw(query, reference, step_pattern="symmetric2", open_end=True, distance_only=True)

    yield "tslearn", "squared Euclidean, soft, one distance", tslearn
    yield "dtaidistance", "Euclidean, hard, one distance, C", dtaidistance
    yield "dtw-python", "Euclidean, hard, open end, C", dtw_python


def whole_queries(console: Console, query: NDArray, reference: NDArray) -> None:
    """All phases of a query, and what others compute of it: the last cost only."""
    runs: dict[str, Run] = {}
    meaning: dict[str, str] = {}
    cases: list[tuple[Distance, float]] = [("wp", GAMMA), ("wp", 0.0), ("euclidean", GAMMA), ("euclidean", 0.0)]
    for distance, gamma in cases:
        name = f"pace_drake, {distance}, gamma {gamma:g}"
        runs[name] = partial(OpenEndSoftDTW(reference, gamma, distance, sample_period=PERIOD).phase, query)
        meaning[name] = f"all {QUERY} phases"
    for name, what, make in others(query, reference):
        try:
            runs[name], meaning[name] = make(), what
        except ImportError as error:
            console.print(f"{name} is left out ({error}): pip install 'pace_drake[bench]'")
    seconds = in_turns(runs)
    first = next(iter(seconds.values())).min()
    table = Table(
        "",
        "computes",
        "best [ms]",
        "median [ms]",
        "ratio",
        title=f"A whole query {query.shape}, reference {reference.shape}",
    )
    for name, times in seconds.items():
        table.add_row(
            name,
            meaning[name],
            f"{times.min() * 1e3:.2f}",
            f"{np.median(times) * 1e3:.2f}",
            f"{times.min() / first:.2f}",
        )
    console.print(table)


def updates(estimator: OpenEndSoftDTW, samples: NDArray) -> NDArray:
    """Seconds (m,) of each update, the interpreter's part included."""
    estimator.update(samples[0])
    estimator.reset()
    seconds = np.empty(len(samples))
    for k, sample in enumerate(samples):
        start = perf_counter()
        estimator.update(sample)
        seconds[k] = perf_counter() - start
    return seconds


def streaming(console: Console, query: NDArray, reference: NDArray) -> None:
    """One update, against the alignment anew; over windows and over samples so far."""
    rng = np.random.default_rng(1)
    long = walk(rng, 10_200)
    table = Table("one more sample", "median [us]", "p99 [us]", title=f"Streaming, reference {reference.shape}")

    def add(name: str, seconds: NDArray) -> None:
        table.add_row(name, f"{np.median(seconds) * 1e6:.1f}", f"{np.percentile(seconds, 99) * 1e6:.1f}")

    for gamma in (GAMMA, 0.0):
        estimator = OpenEndSoftDTW(reference, gamma, sample_period=PERIOD)
        add(f"update, wp, gamma {gamma:g}", updates(estimator, long))
    estimator = OpenEndSoftDTW(reference, GAMMA, sample_period=PERIOD)
    again = in_turns({"": lambda: estimator.phase(query)})[""]
    add(f"the alignment of {QUERY} samples anew", again)
    for window in (0.5, 1.0, 2.0, 5.0, 10.0):
        estimator = OpenEndSoftDTW(reference, GAMMA, window=window, sample_period=PERIOD)
        add(f"update, window {window:g} s", updates(estimator, long[:3000])[round(window / PERIOD) :])
    estimator = OpenEndSoftDTW(reference, GAMMA, sample_period=PERIOD)
    seconds = updates(estimator, long)
    add("update, samples 100 to 300", seconds[100:300])
    add("update, samples 10,000 to 10,200", seconds[10_000:])
    console.print(table)


def many_queries(console: Console, reference: NDArray) -> None:
    """A batch on one thread and on two."""
    rng = np.random.default_rng(2)
    queries = [walk(rng, QUERY) for _ in range(1000)]
    estimator = OpenEndSoftDTW(reference, GAMMA, sample_period=PERIOD)
    block = bytes(512 * 2**20)

    def hashes(num_threads: int) -> None:
        with ThreadPoolExecutor(num_threads) as pool:
            list(pool.map(lambda _: sha256(block).digest(), range(2)))

    runs = {f"{k}": partial(estimator.phases, queries, num_threads=k) for k in (1, 2)}
    # What the machine's second core is worth just now: hashes need no memory and no lock.
    controls = {f"control {k}": partial(hashes, k) for k in (1, 2)}
    one, two, control_one, control_two = (times.min() for times in in_turns({**runs, **controls}, rounds=4).values())
    table = Table("", "best [s]", "queries a second", title=f"{len(queries)} queries, wp, gamma {GAMMA:g}")
    for name, best in (("1 thread", one), ("2 threads", two)):
        table.add_row(name, f"{best:.2f}", f"{len(queries) / best:.0f}")
    gain = f"2 threads are {one / two:.2f} times as fast as 1 (SHA-256: {control_one / control_two:.2f} times)."
    console.print(table, gain)


def main() -> None:
    """Prints all tables."""
    console = Console()
    rng = np.random.default_rng(0)
    query, reference = walk(rng, QUERY), walk(rng, REFERENCE)
    whole_queries(console, query, reference)
    streaming(console, query, reference)
    many_queries(console, reference)


if __name__ == "__main__":
    main()
