"""Times decisions of the twin, its SB3 interface, plain Python and the diagram: ``python benchmarks/bench_twin.py``.

All in one run, on all cores for the twin and on one for the others. The plain environment (plain_env.py) has no phase,
no chart and no ports, so that it does less than the others. Ratios mean something only within one run.
"""

from time import perf_counter

import numpy as np
from plain_env import PlainEnv
from rich.console import Console
from rich.table import Table

from pace_drake.envs.assembly_env import PaceAssemblyEnv
from pace_drake.envs.kernel import FINISHED
from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.envs.vector_env import PaceAssemblyVectorEnv
from pace_drake.learning.vec_env import TwinVecEnv
from pace_drake.people import load_people
from pace_drake.scenario import load_scenario

SECONDS = 3.0


def rate(step, per_step: int) -> float:
    """Decisions per second of ``step``, after one that is not counted."""
    step()
    count, start = 0, perf_counter()
    while perf_counter() - start < SECONDS:
        for _ in range(10):
            step()
        count += 10 * per_step
    return count / (perf_counter() - start)


def main() -> None:
    scenario, rng = load_scenario("ikea_chair"), np.random.default_rng(0)
    pool = make_pool(scenario, load_people(scenario), 256, rng)
    shown = Table("environment", "n", "threads", "decisions/s", title="Decisions")

    def add(name: str, n: int, value: float, threads: int = 1) -> None:
        shown.add_row(name, str(n), str(threads), f"{value:,.0f}")

    for n, threads in ((1, 1), (64, 1), (256, 1), (256, 2), (1024, 1), (1024, 2), (4096, 1), (4096, 2)):
        twin = AssemblyTwin(scenario, pool, n, threads)
        twin.start(np.arange(n), pool.sample(n, rng))
        answers = (rng.random((64, n)) < 0.2).astype(float)
        at = iter(range(10**9))

        def step(twin: AssemblyTwin = twin, answers: np.ndarray = answers, at=at) -> None:
            twin.step(answers[next(at) % 64])
            ended = np.flatnonzero(twin.status == FINISHED)
            if len(ended):
                twin.start(ended, pool.sample(len(ended), rng))

        add("twin", n, rate(step, n), threads)
    vec = TwinVecEnv(PaceAssemblyVectorEnv(scenario, 256, pool))
    vec.reset()
    actions = (rng.random((64, 256)) < 0.2).astype(int)
    turn = iter(range(10**9))
    add("twin through SB3's VecEnv", 256, rate(lambda: vec.step(actions[next(turn) % 64]), 256))
    plain = PlainEnv(scenario.task)
    plain.reset(options={"episode": pool.episode(pool.sample(1, rng)[0])})

    def plain_step() -> None:
        if plain.step(int(rng.random() < 0.2))[2]:
            plain.reset(options={"episode": pool.episode(pool.sample(1, rng)[0])})

    add("plain Python, without phase", 1, rate(plain_step, 1))
    env = PaceAssemblyEnv(scenario)
    env.reset(seed=0)

    def diagram_step() -> None:
        *_, terminated, truncated, _ = env.step(int(rng.random() < 0.2))
        if terminated or truncated:
            env.reset()

    add("diagram", 1, rate(diagram_step, 1))
    Console().print(shown)


if __name__ == "__main__":
    main()
