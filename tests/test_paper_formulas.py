"""Formulas of the paper that cannot be meant as printed (docs/departures.md): printed, resolved, and what runs."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import truncnorm

from pace_drake.diagram import Assembly
from pace_drake.dtw import OpenEndSoftDTW
from pace_drake.envs.kernel import FINISHED
from pace_drake.envs.pool import Pool, exact_phases, make_pool
from pace_drake.people import People
from pace_drake.scenario import Scenario
from pace_drake.simulation import Simulation, Stop
from pace_drake.task import (
    NUM_ROBOT_DRAWS,
    ActionKind,
    Assistance,
    Duration,
    Episode,
    HumanAction,
    RobotTask,
    Task,
    sample_episode,
)
from tests.envs.test_twin import plain_env, twin_episodes
from tests.naive import naive_accumulated_cost


class Rows(NamedTuple):
    """At each decision, and at the end."""

    observation: np.ndarray  # i, j, Delta_start [s], tau
    time: np.ndarray
    robot_idle: np.ndarray
    human_idle: np.ndarray
    cost: np.ndarray


def make_scenario(alpha, num_robot_tasks, **changes):
    actions = [
        HumanAction(name=f"h{j}", assistance=Assistance() if j in alpha else None) for j in range(1, alpha[-1] + 1)
    ]
    robot_tasks = [RobotTask(name=f"r{i}") for i in range(num_robot_tasks)]
    scenario = Scenario(task=Task(human_actions=actions, robot_tasks=robot_tasks), **changes)
    scenario.validate()
    return scenario


def make_episode(human, robot, preparation, homing):
    return Episode(
        human=np.array(human, dtype=float),
        demonstration=np.full(len(human), -1),
        robot=np.tile(np.array(robot, dtype=float), (NUM_ROBOT_DRAWS, 1)),
        preparation=np.array(preparation, dtype=float),
        homing=np.array(homing, dtype=float),
    )


def nobody(scenario):
    n = scenario.task.num_human_actions
    return People([[] for _ in range(n)], [None] * n, [[] for _ in range(n)], True, "nobody")


def diagram_rows(simulation, episode, decisions):
    simulation.reset(episode)
    rows = []
    while True:
        stop = simulation.advance()
        idle = simulation.output("robot_idle").copy(), simulation.output("human_idle").copy()
        rows.append((simulation.output("observation").copy(), simulation.time, *idle, simulation.output("cost")[0]))
        if stop == Stop.FINISHED:
            return Rows(*map(np.array, zip(*rows, strict=True)))
        simulation.decide(int(decisions[len(rows) - 1]))


def plain_rows(plain, episode, decisions):
    observation, _ = plain.reset(options={"episode": episode})
    rows, cost, finished = [], 0.0, False
    while True:
        rows.append((observation, plain.time, plain.robot_idle.copy(), plain.human_idle.copy(), cost))
        if finished:
            return Rows(*map(np.array, zip(*rows, strict=True)))
        observation, reward, finished, *_ = plain.step(decisions[len(rows) - 1])
        cost -= reward


def assert_same(rows, expected, elements=3):
    for name in ("time", "robot_idle", "human_idle"):
        np.testing.assert_allclose(getattr(rows, name), getattr(expected, name), rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows.cost, expected.cost, rtol=0, atol=1e-8)
    observations = [r.observation[:-1, :elements] for r in (rows, expected)]  # what is seen at the end is not used
    np.testing.assert_allclose(*observations, rtol=1e-6, atol=1e-5)  # single precision


def play(scenario, episode, decisions, people=None):
    """One episode by the twin, and the same by the diagram; after the decisions, assistance. Nobody has no phase."""
    elements, people = (4, people) if people else (3, nobody(scenario))
    decisions = np.concatenate([decisions, np.ones(scenario.task.num_joint_actions + 1, dtype=int)])
    human, demonstration = episode.human[:, np.newaxis], episode.demonstration[:, np.newaxis]
    pool = Pool(
        1,
        human,
        demonstration,
        exact_phases(scenario, people, human, demonstration),
        episode.robot[np.newaxis],
        episode.preparation[np.newaxis],
        episode.homing[np.newaxis],
    )
    parts = np.zeros((1, pool.num_parts), dtype=int)
    _, *columns = twin_episodes(scenario, pool, parts, decisions[np.newaxis])
    rows = Rows(*(column[:, 0] for column in columns))
    assert_same(rows, diagram_rows(Simulation(Assembly(scenario, people=people)), episode, decisions), elements)
    return rows


# --- the POMDP ---

# Two actions, joint action, one action, joint action; [s].
ALPHA, HUMAN, ROBOT, PREPARATION = (3, 5), (10, 20, 5, 7, 6), (8, 8, 8), (11, 8)
LATE = [0, 0, 0, 0, 0, 1, 0, 1]  # the person waits for the robot, twice


@pytest.fixture(scope="module")
def late():
    return play(make_scenario(ALPHA, 3), make_episode(HUMAN, ROBOT, PREPARATION, (4, 9)), LATE)


@pytest.fixture(scope="module")
def early():
    return play(make_scenario(ALPHA, 3), make_episode(HUMAN, ROBOT, PREPARATION, (4, 9)), [1, 1])


@pytest.mark.parametrize("M", [1, 2, 4])
def test_robot_index(M):
    def literal(index):
        return (index + 1) % M

    def resolved(i):
        return i % M + 1

    decisions = [0, 0, 0, 1, 0, 0]
    i = play(make_scenario(ALPHA, M), make_episode(HUMAN, [8] * M, PREPARATION, (4, 9)), decisions).observation[:, 0]
    expected = [M]
    for a in decisions:
        expected.append(resolved(expected[-1]) if a == 0 else expected[-1])
    assert list(i[: len(expected)]) == expected
    assert {resolved(i) for i in range(1, M + 1)} == set(range(1, M + 1))
    literals = {literal(i) for i in range(1, M + 1)}
    assert 0 in literals  # no such task
    assert M not in literals
    tasks = [i for i, a in zip(expected[1:], decisions, strict=True) if a == 0]
    assert [literal(joint) for joint in (1, 1, 1, 2, 2)] != tasks  # with l, as printed: one task again and again


def transitions(rows, decisions):
    """(j, Delta_start, Delta, j', Delta'_start) of each robot task."""
    _, j, start, _ = rows.observation.T
    delta = np.diff(rows.time)
    return [(int(j[k]), start[k], delta[k], int(j[k + 1]), start[k + 1]) for k, a in enumerate(decisions) if a == 0]


def test_current_human_action(late):
    def smallest(j, reached):
        return next(k for k in range(j, len(HUMAN) + 1) if reached <= sum(HUMAN[j - 1 : k]))

    def literal(j, start, delta):
        return smallest(j, delta)

    def unclamped(j, start, delta):
        return smallest(j, delta + start)

    def resolved(j, start, delta):
        return min(smallest(j, delta + start), next(alpha for alpha in ALPHA if alpha >= j))

    found = transitions(late, LATE)
    assert [j for *_, j, _ in found] == [1, 2, 2, 3, 3, 5]
    assert [resolved(*state) for *state, _, _ in found] == [1, 2, 2, 3, 3, 5]
    assert [literal(*state) for *state, _, _ in found] == [1, 1, 2, 2, 4, 5]
    assert [unclamped(*state) for *state, _, _ in found] == [1, 2, 2, 3, 4, 5]  # the joint action done alone


def test_time_since_the_human_action_began(late):
    def literal(j, start, delta, new_j):
        return delta - start - sum(HUMAN[j - 1 : new_j - 1])

    def resolved(j, start, delta, new_j):
        return delta + start - sum(HUMAN[j - 1 : new_j - 1])

    found = transitions(late, LATE)
    assert [new for *_, new in found] == pytest.approx([8, 6, 14, 2, 10, 5])  # from the fourth on, since waiting began
    assert [resolved(*state) for *state, _ in found] == pytest.approx([8, 6, 14, 2, 10, 5])
    assert [literal(*state) for *state, _ in found] == pytest.approx([8, -10, 2, -26, 6, -3])


def test_duration_of_an_assistance(early):
    def literal(P, W, J, E):
        return P + J + E

    def resolved(P, W, J, E):
        return max(P, W) + J + E

    first, second = (11, 30, 5, 4), (8, 7 - 4, 6, 9)  # the robot waits; the person waits
    assert list(np.diff(early.time)) == pytest.approx([39, 23])
    assert [resolved(*first), resolved(*second)] == [39, 23]
    assert [literal(*first), literal(*second)] == [20, 23]  # the first assistance over, the person in action 2
    assert early.robot_idle[-1] == pytest.approx([30 - 11, 0])
    assert list(early.observation[1, :3]) == pytest.approx([3, 4, 4])  # the next action began with the homing


def test_homing_has_its_own_duration(early):
    def literal(P, W, J, E):
        return max(P, W) + J + P

    assert literal(11, 30, 5, 4) == 46
    assert early.time[1] == pytest.approx(30 + 5 + 4)
    task = Task(
        human_actions=[HumanAction(name="h", assistance=Assistance(preparation=Duration(mean=11.0, cv=0.1)))],
        robot_tasks=[RobotTask(name="r")],
    )
    task.human_actions[0].assistance.homing = Duration(mean=4.0, cv=0.1)
    drawn = [sample_episode(task, np.random.default_rng(seed), [0]) for seed in range(200)]
    assert np.mean([episode.preparation[0] for episode in drawn]) == pytest.approx(11.0, abs=0.3)
    assert np.mean([episode.homing[0] for episode in drawn]) == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize(("homing", "printed", "total"), [((4, 9), 51, 34), ((20, 9), 83, 50)])
def test_human_idle_adds_up_to_the_cost(homing, printed, total):
    """Homing of 20 s outlasts the next action: the wait during it counts as well, in that transition."""

    def literal(busy, W, home, segment):
        return max(0, busy - W)  # busy: Delta^R or P; W: sum of Delta_k - Delta_start, below zero in a wait

    def without_homing(busy, W, home, segment):
        return max(0, busy - max(W, 0))

    def resolved(busy, W, home, segment):
        return max(0, busy - max(W, 0)) + max(0, home - segment)

    rows = play(make_scenario(ALPHA, 3), make_episode(HUMAN, ROBOT, PREPARATION, homing), LATE)
    steps = [(8, 30 - k * 8, 0, 0) for k in range(5)] + [(11, 30 - 40, homing[0], 7)]  # no one works after the last
    steps += [(8, 7 - homing[0], 0, 0), (8, 7 - homing[0] - 8, 0, 0)]
    ready, begun = (30, 56 + 7), (40 + 11, 56 + homing[0] + 8 + 8)  # the person, the joint actions
    assert rows.human_idle[-1] == pytest.approx(np.subtract(begun, ready))
    assert np.diff(rows.human_idle.sum(axis=1)) == pytest.approx([resolved(*step) for step in steps])
    assert rows.cost[-1] == pytest.approx(0 + 3 * total)  # as in Table I: robot + 3 human
    assert sum(resolved(*step) for step in steps) == total
    assert sum(literal(*step) for step in steps) == printed  # earlier waiting charged again
    assert sum(without_homing(*step) for step in steps) == total - max(0, homing[0] - 7)


def test_durations_are_truncated():
    u = (np.arange(1000) + 0.5) / 1000

    def literal(mean, std):
        return mean + std * ndtri(u)

    def resolved(mean, std):
        return truncnorm.ppf(u, -mean / std, np.inf, loc=mean, scale=std)

    assert literal(5.0, 4.0).min() < -5
    draws = Duration(mean=5.0, cv=0.8).quantile(u)
    assert draws.min() > 0
    np.testing.assert_allclose(draws, resolved(5.0, 4.0), rtol=1e-9)


def test_phase_is_one_while_waiting_and_in_joint_actions(chair, chair_people):
    def literal(j, hand):
        return OpenEndSoftDTW(chair_people.references[j - 1].p_WH).phase(hand)

    for j in chair.task.human_index_of_joint:
        with pytest.raises(AttributeError, match="'NoneType'"):  # demonstrations are of H \ J alone
            literal(j, np.zeros((5, 3)))
    episode = chair_people.sample(chair, np.random.default_rng(0))
    _, j, start, phase = play(chair, episode, [0] * 5, chair_people).observation[:6].T
    assert list(j[-2:]) == [2, 2]
    assert start[-1] == pytest.approx(start[-2] + episode.robot[4, 0])  # waits
    assert list(phase[j == 2]) == [1] * np.sum(j == 2)
    assert (phase[j == 1] < 1).all()
    simulation = Simulation(Assembly(chair, people=chair_people))
    simulation.reset(episode)
    simulation.advance()
    simulation.decide(1)
    begun = max(episode.human[0], episode.preparation[0])
    for share in (0.01, 0.5, 0.99):
        simulation.advance(begun + share * episode.human[1])
        assert simulation.output("robot_action")[0] == ActionKind.JOINT
        assert (simulation.output("human_action")[0], simulation.output("phase")[0]) == (2, 1)


def test_the_first_decision_comes_at_the_start():
    """Two robot tasks of 8 s; the person needs 5 s, and so does the preparation."""

    def literal(robot, human, preparation):  # between robot tasks, so after the first
        return robot, 3 * max(0, robot + preparation - human)

    def resolved(robot, human, preparation):
        return 0, 3 * max(0, preparation - human)

    assert (literal(8, 5, 5), resolved(8, 5, 5)) == ((8, 24), (0, 0))
    episode = make_episode((5, 6), (8, 8), (5,), (1,))
    for decide_at_start, expected, seen in ((True, resolved, [2, 1, 0]), (False, literal, [1, 2, 3])):
        rows = play(make_scenario((2,), 2, decide_at_start=decide_at_start), episode, [1])
        assert (rows.time[0], rows.cost[-1]) == pytest.approx(expected(8, 5, 5))
        assert list(rows.observation[0, :3]) == seen


# --- Algorithm 1 and Eq. 3 ---


@pytest.mark.parametrize("gamma", [0.0, 1e-3])
def test_argmin_of_algorithm_1(gamma):
    reference = np.array([[0.0], [1.0], [3.0], [6.0], [10.0]])
    R = naive_accumulated_cost(reference, reference, gamma, "euclidean")[1:]
    n = len(reference)

    def literal(row):
        return row[:n].argmin() / (n - 1)

    def resolved(row):
        return row[1:].argmin() / (n - 1)

    assert np.isinf(R[:, 0]).all()
    assert [literal(row) for row in R] == [0.25, 0.5, 0.75, 1, 1]  # one ahead, and never the last sample
    truth = [0, 0.25, 0.5, 0.75, 1]
    assert [resolved(row) for row in R] == truth
    assert list(OpenEndSoftDTW(reference, gamma, "euclidean").phase(reference)) == truth


def test_windowed_pearson_near_the_start_and_of_a_still_hand():
    """The first axis moves; the second rests, in both."""
    w, p, q = 3, np.array([0.0, 1, 0, 5, 5, 5, 7]), np.array([0.0, 2, 1, 4, 4, 4])

    def distance(a, b):
        with np.errstate(invalid="ignore", divide="ignore"):
            return 1 - np.mean((a - a.mean()) * (b - b.mean())) / np.sqrt(a.var() * b.var())

    def literal(i, j):
        if min(i, j) < w - 1:
            raise IndexError(f"no sample {min(i, j) - w + 1}")
        return distance(p[i - w + 1 : i + 1], q[j - w + 1 : j + 1])

    def resolved(i, j):
        k = min(w, i + 1, j + 1)
        a, b = p[i - k + 1 : i + 1], q[j - k + 1 : j + 1]
        return 1.0 if k < 2 or np.ptp(a) == 0 or np.ptp(b) == 0 else distance(a, b)

    estimator = OpenEndSoftDTW(np.column_stack([q, np.full(6, 0.5)]), window=0.3)
    state = estimator.initial_state()
    costs = []
    for sample in p:
        estimator.step(state, [sample, -2.0])
        costs.append(estimator.local_cost(state) - 1.0)  # of the axis at rest
    costs = np.array(costs)
    np.testing.assert_allclose(costs, [[resolved(i, j) for j in range(6)] for i in range(7)], atol=1e-9)
    assert costs[:3, :3] == pytest.approx(np.array([[1, 1, 1], [1, 0, 2], [1, 2, 1 - np.sqrt(0.75)]]), abs=1e-9)
    assert costs[5] == pytest.approx(1)
    assert costs[:, 5] == pytest.approx(1)
    with pytest.raises(IndexError, match="no sample -1"):
        literal(1, 4)
    assert np.isnan([literal(5, 5), literal(5, 2), literal(6, 5)]).all()  # 0/0
    assert literal(2, 2) == pytest.approx(costs[2, 2])


# --- all together, on random structures ---


def random_scenario(rng):
    """0 to 3 actions before the first joint action, 1 to 3 before the others (two in a row are not allowed)."""

    def duration():
        mean = rng.uniform(1, 20) if rng.random() < 0.7 else 10 ** rng.uniform(-4, 0)
        return Duration(mean=mean, cv=rng.choice([0.0, 0.3]))

    joint = []
    for k in range(rng.integers(1, 5)):
        joint += [False] * rng.integers(k > 0, 4) + [True]
    actions = [
        HumanAction(
            name=f"h{j}",
            duration=duration(),
            assistance=Assistance(preparation=duration(), homing=duration()) if with_robot else None,
        )
        for j, with_robot in enumerate(joint)
    ]
    robot_tasks = [RobotTask(name=f"r{i}", duration=duration()) for i in range(rng.integers(1, 5))]
    task = Task(human_actions=actions, robot_tasks=robot_tasks, human_idle_weight=10 ** rng.uniform(-1, 1))
    scenario = Scenario(name="random", task=task)
    scenario.validate()
    return scenario


def random_decisions(rng, num_episodes):
    decisions = (rng.random((num_episodes, 60)) < rng.random((num_episodes, 1))).astype(int)
    decisions[:, 50:] = 1  # so that all end
    return decisions


def test_the_twin_keeps_the_resolved_event_order():
    seen = dict.fromkeys(("joint first", "one robot task", "long homing", "robot waits", "person waits", "short"), 0)
    for seed in range(80):
        rng = np.random.default_rng(seed)
        scenario = random_scenario(rng)
        alpha = scenario.task.human_index_of_joint
        pool = make_pool(scenario, nobody(scenario), 8, rng)
        parts, decisions = pool.sample(10, rng), random_decisions(rng, 10)
        plain = plain_env(scenario.task)
        status, *columns = twin_episodes(scenario, pool, parts, decisions)
        for e, row in enumerate(parts):
            episode = pool.episode(row)
            end = np.argmax(status[:, e] == FINISHED) + 1
            rows = Rows(*(column[:end, e] for column in columns))
            assert_same(rows, plain_rows(plain, episode, decisions[e]))
            segments = [episode.human[a : b - 1].sum() for a, b in pairwise(alpha)]
            seen["long homing"] += (episode.homing[:-1] > segments).any()
            seen["robot waits"] += rows.robot_idle[-1].any()
            seen["person waits"] += rows.human_idle[-1].any()
            seen["short"] += episode.human.min() < 0.01
        seen["joint first"] += alpha[0] == 1
        seen["one robot task"] += scenario.task.num_robot_tasks == 1
    assert min(seen.values()) >= 10


def test_the_diagram_keeps_the_resolved_event_order():
    for seed in range(1000, 1006):
        rng = np.random.default_rng(seed)
        scenario = random_scenario(rng)
        simulation, plain = Simulation(Assembly(scenario, people=nobody(scenario))), plain_env(scenario.task)
        for decisions in random_decisions(rng, 8):
            episode = simulation.sample_episode(rng)
            rows = diagram_rows(simulation, episode, decisions)
            assert_same(rows, plain_rows(plain, episode, decisions))


def test_a_decision_at_the_very_end_of_an_action_sees_the_next_one():
    """A matter of taste, which only fixed durations meet: twin and diagram agree on it."""
    rows = play(make_scenario((3,), 1), make_episode((8, 20, 5), (8,), (11,), (4,)), [0, 1])
    assert rows.time[1] == 8
    assert list(rows.observation[1, :3]) == [1, 2, 0]
