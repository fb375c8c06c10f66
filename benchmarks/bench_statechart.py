"""Times a reaction of the task's chart beside other engines, on one trace: ``python benchmarks/bench_statechart.py``.

Rounds take turns. "best" is the least of all rounds; ratios are those of best times, and mean something only within one
run. Engines that are not installed are left out, and named.
"""

import importlib.util
from collections.abc import Callable
from time import perf_counter

import numpy as np
from numba import njit
from rich.console import Console
from rich.table import Table

from pace_drake.resources import resource_path
from pace_drake.statechart import compile_chart, load_chart
from pace_drake.statechart.lower import EVENT, to_sismic

REACTIONS, ROUNDS = 2000, 15


def main() -> None:
    console = Console()
    compiled = compile_chart(load_chart(resource_path("statecharts/pace_task.scxml")))
    rng = np.random.default_rng(0)
    p = compiled.parameters()
    x, inputs = compiled.initial_state(), []
    for _ in range(REACTIONS):  # prompt surroundings: everything is done at once, decisions by chance
        done, here = x[compiled.variable_index["cmd"]], x[compiled.variable_index["l"]]
        u = compiled.inputs(a=rng.integers(2), done=done, hj=here, nj=here, start=x[0] != 9)
        inputs.append(u)
        x, _ = compiled.react(x, u, p, 0.0)
    lists = [u.tolist() for u in inputs]
    table = np.array(inputs)

    def python(vectors: list, start: Callable, parameters) -> None:
        state = start()
        for u in vectors:
            state, _ = compiled.react(state, u, parameters, 0.0)

    in_place = njit(compiled.react_in_place)

    @njit
    def kernel(state, rows, parameters):
        for row in rows:
            in_place(state, row, parameters, 0.0)

    runs: dict[str, Callable[[], None]] = {
        "compiled chart, lists": lambda: python(lists, lambda: compiled.initial_state().tolist(), p.tolist()),
        "compiled chart, arrays": lambda: python(inputs, compiled.initial_state, p),
        "compiled chart, numba": lambda: kernel(compiled.initial_state(), table, p),
    }
    if importlib.util.find_spec("sismic") is None:
        console.print("sismic is not installed: left out (pip install sismic)")
    else:
        from sismic.interpreter import Interpreter
        from sismic.io import import_from_yaml
        from sismic.model import Event

        chart = import_from_yaml(to_sismic(compiled))
        names = list(compiled.input_index)

        def sismic() -> None:
            dut = Interpreter(chart)
            dut.execute()
            for u in lists:
                dut.queue(Event(EVENT, now=0.0, **dict(zip(names, u, strict=True))))
                dut.execute_once()

        runs["sismic, lowered chart"] = sismic
    best = dict.fromkeys(runs, np.inf)
    for run in runs.values():
        run()
    for _ in range(ROUNDS):
        for name, run in runs.items():
            start = perf_counter()
            run()
            best[name] = min(best[name], perf_counter() - start)
    shown = Table("engine", "best [us per reaction]", "times the compiled chart on lists", title="One reaction")
    for name, seconds in best.items():
        shown.add_row(name, f"{seconds / REACTIONS * 1e6:.3f}", f"{seconds / best['compiled chart, lists']:.2f}")
    console.print(shown)


if __name__ == "__main__":
    main()
