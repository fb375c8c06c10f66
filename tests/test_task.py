"""pace_drake.task: validation names the field, durations follow their distribution."""

import networkx as nx
import numpy as np
import pytest
from scipy import stats

from pace_drake.errors import InputError
from pace_drake.task import Assistance, Duration, HumanAction, RobotTask, Task, sample_episode


def joint(name):
    return HumanAction(name=name, assistance=Assistance())


def make_task(*actions, **kwargs):
    return Task(human_actions=list(actions), robot_tasks=[RobotTask(name="sort")], **kwargs)


def test_indices_of_the_chair(chair):
    task = chair.task
    assert (task.num_human_actions, task.num_joint_actions, task.num_robot_tasks) == (6, 3, 4)
    assert task.human_index_of_joint == (2, 4, 6)  # alpha(l) = 2l, notes
    assert [a.duration.mean for a in task.human_actions if not a.joint] == [22, 18, 40]
    assert [a.preparation.mean for a in task.assistances] == [11, 8, 9]
    assert task.human_idle_weight == 3


@pytest.mark.parametrize(
    ("task", "field"),
    [
        (make_task(joint("a"), human_idle_weight=0.0), "task.human_idle_weight"),
        (make_task(joint("a"), human_idle_weight=float("nan")), "task.human_idle_weight"),
        (make_task(), "task.human_actions"),
        (Task(human_actions=[joint("a")]), "task.robot_tasks"),
        (make_task(HumanAction(name="a")), r"task.human_actions\[0\].assistance: the last human action"),
        (make_task(joint("a"), joint("b")), r"task.human_actions\[1\].assistance: 'b' follows another joint"),
        (make_task(HumanAction(name="a"), joint("a")), r"task.human_actions\[1\].name: 'a' is used twice"),
        (make_task(HumanAction(name=""), joint("b")), r"task.human_actions\[0\].name"),
        (
            make_task(HumanAction(name="a", duration=Duration(mean=-1)), joint("b")),
            r"task.human_actions\[0\].duration.mean",
        ),
        (
            make_task(HumanAction(name="a", duration=Duration(cv=-0.1)), joint("b")),
            r"task.human_actions\[0\].duration.cv",
        ),
        (
            make_task(HumanAction(name="a", duration=Duration(minimum=2.0)), joint("b")),
            r"task.human_actions\[0\].duration.minimum",
        ),
        (
            make_task(HumanAction(name="a", duration=Duration(distribution="gamma")), joint("b")),
            r"task.human_actions\[0\].duration.distribution",
        ),
    ],
)
def test_errors_name_the_field(task, field):
    with pytest.raises(InputError, match=field):
        task.validate()


def test_precedence_is_a_dag_in_which_preparation_comes_before_joint_and_joint_before_homing(chair):
    graph = chair.task.precedence()
    assert nx.is_directed_acyclic_graph(graph)
    order = list(nx.lexicographical_topological_sort(graph))
    for name in ("carry_side", "hand_key", "hand_second_key"):
        assert order.index(f"prepare {name}") < order.index(name) < order.index(f"home {name}")
        assert graph.nodes[name]["agent"] == "joint"
    assert nx.has_path(graph, "home carry_side", "prepare hand_key")
    assert nx.has_path(graph, "place_rails", "hand_second_key")
    assert not nx.has_path(graph, "place_rails", "prepare carry_side")  # the robot may prepare at any time


@pytest.mark.parametrize("distribution", ["truncated_gaussian", "log_normal"])
def test_durations_follow_their_distribution(distribution):
    u = (np.arange(20_000) + 0.5) / 20_000
    draws = Duration(mean=20.0, cv=0.25, distribution=distribution).quantile(u)
    assert draws.mean() == pytest.approx(20.0, rel=2e-3)
    assert draws.std() == pytest.approx(5.0, rel=2e-2)
    assert np.all(np.diff(draws) > 0)
    skewed = np.mean((draws - 20) ** 3) / 5**3
    assert (skewed > 0.5) == (distribution == "log_normal")


@pytest.mark.parametrize("distribution", ["truncated_gaussian", "log_normal"])
def test_no_duration_is_shorter_than_the_minimum(distribution):
    draws = Duration(mean=8.0, cv=0.5, minimum=6.0, distribution=distribution).quantile(np.linspace(0, 0.999, 1000))
    assert draws.min() == pytest.approx(6.0)
    assert draws[1] > draws[0]  # truncated, not clipped


def test_a_wide_gaussian_is_never_negative():
    assert Duration(mean=1.0, cv=2.0).quantile(np.linspace(0, 0.999, 1000)).min() >= 0


def test_episodes_repeat_with_the_seed_and_differ_without(chair):
    counts = [5, 0, 5, 0, 5, 0]
    first, same, other = (sample_episode(chair.task, np.random.default_rng(s), counts) for s in (1, 1, 2))
    for name in ("human", "demonstration", "robot", "preparation", "homing"):
        assert np.array_equal(getattr(first, name), getattr(same, name))
        assert not np.array_equal(getattr(first, name), getattr(other, name))
    assert list(first.demonstration[[1, 3, 5]]) == [-1, -1, -1]
    assert np.all(first.demonstration < 5)


@pytest.mark.parametrize("distribution", ["truncated_gaussian", "log_normal"])
@pytest.mark.parametrize(("cv", "minimum"), [(0.25, 5.0), (0.6, 0.0), (0.1, 19.9)])
def test_the_cdf_is_the_inverse_of_the_quantile(distribution, cv, minimum):
    duration = Duration(mean=20.0, cv=cv, minimum=minimum, distribution=distribution)
    u = np.linspace(0.001, 0.999, 50)
    np.testing.assert_allclose(duration.cdf(duration.quantile(u)), u, atol=1e-9)
    assert duration.cdf(minimum - 1e-6) == 0.0
    assert duration.cdf(1e4) == 1.0
    assert Duration(mean=3.0).cdf([2.9, 3.0]).tolist() == [0.0, 1.0]


def test_paces_go_together_and_leave_each_distribution_as_it_is(chair):
    """A Gaussian copula over non-joint actions."""
    rng = np.random.default_rng(0)
    counts = [1, 0] * 3
    drawn = np.array([sample_episode(chair.task, rng, counts, rng.standard_normal(), 0.7).human for _ in range(6000)])
    scores = stats.norm.ppf(stats.rankdata(drawn, axis=0) / (len(drawn) + 1))
    correlation = np.corrcoef(scores.T)
    for j, action in enumerate(chair.task.human_actions):
        assert stats.kstest(drawn[:, j], action.duration.cdf).pvalue > 1e-3
        for k in range(j):
            both = j % 2 == k % 2 == 0
            assert correlation[j, k] == pytest.approx(0.7 if both else 0.0, abs=0.05)


def test_a_slow_person_is_slow(chair):
    def mean(pace):
        rngs = [np.random.default_rng(k) for k in range(200)]
        return np.mean([sample_episode(chair.task, rng, [1, 0] * 3, pace, 0.7).human[4] for rng in rngs])

    slow, fast = mean(1.5), mean(-1.5)
    assert slow > 1.3 * fast
