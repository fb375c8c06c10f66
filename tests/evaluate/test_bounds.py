"""The optimum without phase, the fitted optimum, perfect phase: against enumeration, and against each other."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from pace_drake.envs.pool import make_pool
from pace_drake.envs.twin import AssemblyTwin
from pace_drake.evaluate.clairvoyant import clairvoyant_cost
from pace_drake.evaluate.fitted_optimum import fitted_optimum
from pace_drake.evaluate.perfect_phase import perfect_phase_table, play_with_perfect_phase
from pace_drake.evaluate.play import play
from pace_drake.evaluate.thresholds import RULES, search_thresholds
from pace_drake.evaluate.timed_optimum import timed_optimum
from pace_drake.people import load_people
from pace_drake.scenario import Scenario, load_scenario
from pace_drake.task import Assistance, Duration, HumanAction, RobotTask, Task
from tests.naive_optimum import naive_optimum


@dataclass(kw_only=True)
class Few(Duration):
    """A few whole numbers of seconds."""

    points: dict

    def quantile(self, probability):
        return np.full(np.shape(probability), float(max(self.points)))

    def cdf(self, seconds):
        return sum(p * (np.asarray(seconds) >= t) for t, p in self.points.items())


def few(rng, low, high, most=3):
    points = rng.choice(np.arange(low, high), size=rng.integers(1, most + 1), replace=False)
    p = rng.dirichlet(np.ones(len(points)))
    return dict(zip(points.tolist(), p.tolist(), strict=True))


@pytest.mark.parametrize("seed", range(12))
def test_the_optimum_without_phase_is_that_of_enumeration(seed):
    """Random structures: up to two actions before a joint action, one to three robot tasks that differ."""
    rng = np.random.default_rng(seed)
    alpha, human = [], []
    for _ in range(rng.integers(1, 4)):
        for _ in range(rng.integers(0 if not human else 1, 3)):
            human.append(few(rng, 3, 25))
        human.append({5: 1.0})
        alpha.append(len(human))
    robot = [few(rng, 2, 9) for _ in range(rng.integers(1, 4))]
    preparation, homing = ([few(rng, 1, 9) for _ in alpha] for _ in range(2))
    weight = float(rng.choice([0.5, 3.0, 10.0]))
    assistances = {
        j: Assistance(preparation=Few(points=p), homing=Few(points=h))
        for j, p, h in zip(alpha, preparation, homing, strict=True)
    }
    task = Task(
        human_idle_weight=weight,
        human_actions=[
            HumanAction(
                name=f"h{k}",
                duration=Few(points=points),
                assistance=assistances.get(k + 1),
            )
            for k, points in enumerate(human)
        ],
        robot_tasks=[RobotTask(name=f"r{k}", duration=Few(points=points)) for k, points in enumerate(robot)],
    )
    expected = naive_optimum(human, robot, preparation, homing, alpha, weight)
    assert timed_optimum(Scenario(task=task), step=1.0).cost == pytest.approx(expected, rel=1e-9)


def without_phase(scenario):
    """Nothing is estimated: fast."""
    return replace(load_people(scenario), references=[None] * scenario.task.num_human_actions)


@pytest.mark.parametrize("overrides", [(), ("task.human_idle_weight=0.5",), ("human.pace_correlation=0",)])
def test_its_policy_costs_what_it_says(overrides):
    scenario = load_scenario("ikea_chair", ("human.split=train", *overrides))
    best = timed_optimum(scenario)
    rng = np.random.default_rng(0)
    pool = make_pool(scenario, without_phase(scenario), 16384, rng)
    twin, parts = AssemblyTwin(scenario, pool, 20_000), pool.sample(20_000, rng)
    played = play(twin, parts, best.policy)
    # The error of the mean, of episodes and of the pool's draws, is about 0.17 s.
    assert played.cost.mean() == pytest.approx(best.cost, abs=0.35)
    table = best.policy.assist
    for shift in (-120, 120):  # 6 s earlier, later
        other = replace(best.policy, assist=np.roll(table, shift, axis=2))
        assert play(twin, parts, other).cost.mean() > played.cost.mean()


def test_without_a_decision_at_the_start():
    """Where one should assist at once, to wait for the first cube costs something."""
    short = load_scenario("ikea_chair", ("task.human_actions.0.duration.mean=9",))
    later = timed_optimum(replace(short, decide_at_start=False)).cost
    assert later > timed_optimum(short).cost + 5


def test_the_grid_is_fine_enough(chair):
    assert timed_optimum(chair, 0.1).cost == pytest.approx(timed_optimum(chair).cost, abs=0.01)


def test_nan_gets_no_answer(chair):
    policy = timed_optimum(chair).policy
    assert policy.decide(np.array([1.0, np.nan, 3.0])) == -1
    assert policy.decide(np.array([1.0, 2.0, 0.0])) == 1  # the person waits


@pytest.fixture(scope="module")
def world():
    scenario = load_scenario("ikea_chair", ("human.split=train",))
    rng = np.random.default_rng(0)
    pool = make_pool(scenario, load_people(scenario), 512, rng)
    return AssemblyTwin(scenario, pool, 8000), pool.sample(8000, rng)


def cost(world, policy):
    return play(*world, policy).cost.mean()


def test_the_fitted_optimum_finds_the_exact_one_where_it_sees_the_same(world):
    exact = cost(world, timed_optimum(world[0].scenario).policy)
    fitted = cost(world, fitted_optimum(*world, "none", ("human_elapsed",)))
    assert fitted == pytest.approx(exact, rel=0.015)


def test_with_phase_it_is_no_worse_than_any_threshold(world):
    fitted = cost(world, fitted_optimum(*world))
    few_episodes = AssemblyTwin(world[0].scenario, world[0].pool, 2000), world[1][:2000]
    for rule in RULES:
        assert fitted < 1.01 * cost(world, search_thresholds(*few_episodes, rule).policy)
    assert fitted < 0.75 * cost(world, timed_optimum(world[0].scenario).policy)


def test_perfect_phase_is_a_bound_and_above_the_clairvoyant(world):
    twin, parts = world
    perfect = play_with_perfect_phase(twin, parts)
    assert perfect.finished.all()
    least = np.array([clairvoyant_cost(twin.scenario, twin.pool.episode(row)) for row in parts[:500]])
    assert (perfect.cost[:500] >= least - 1e-9).all()
    assert least.mean() < perfect.cost.mean() < 0.8 * cost(world, fitted_optimum(*world))


def test_perfect_phase_by_hand():
    """Tasks of 4 s, preparation of 2 s: assist unless one more task fits, in time, before the person is ready."""
    actions = [
        HumanAction(name="h", duration=Duration(mean=20.0)),
        HumanAction(name="j", assistance=Assistance(preparation=Duration(mean=2.0), homing=Duration(mean=1.0))),
    ]
    task = Task(
        human_actions=actions,
        robot_tasks=[RobotTask(name="r", duration=Duration(mean=4.0))],
        human_idle_weight=3.0,
    )
    (row,) = perfect_phase_table(Scenario(task=task), step=1.0)

    @partial(np.vectorize, otypes=[float])
    def value(w):
        now = max(w - 2, 0) + 3 * max(2 - w, 0)
        late = 3 * max(4 - w, 0) + (6 if w <= 4 else value(w - 4))
        return min(now, late)

    for w in range(1, 20):
        now = max(w - 2, 0) + 3 * max(2 - w, 0)
        late = 3 * max(4 - w, 0) + (6 if w <= 4 else float(value(w - 4)))
        assert row[w] == (now <= late), w
