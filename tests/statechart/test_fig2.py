"""The paper's figure, literally, and the chart with counters start the same actions for every word of decisions."""

import itertools

import pytest

from pace_drake.resources import resource_path
from pace_drake.statechart import CompiledChart, compile_chart, load_chart
from pace_drake.task import ActionKind
from tests.statechart.fig2 import literal_chart
from tests.statechart.traces import shipped

Actions = list[tuple[str, int]]


def test_the_shipped_figure_is_fresh():
    assert resource_path("statecharts/fig2_literal.scxml").read_text() == literal_chart(4, 3)


def literal_actions(chart: CompiledChart, word: tuple[int, ...]) -> Actions:
    x = chart.initial_state().tolist()
    started = chart.variable_index["started"]

    def action() -> tuple[str, int]:
        assisting, index = chart.outputs(x, [])
        return ("assist" if assisting else "task"), int(index)

    actions = [action()]
    for a in word:
        # The action is done; its end is seen before the decision, which stays until something starts.
        x, _ = chart.react(x, chart.inputs(done=1).tolist(), [], 0.0)
        if chart.leaf(x) == "DONE":
            break
        before = x[started]
        for _ in range(3):
            x, _ = chart.react(x, chart.inputs(done=1, a=a).tolist(), [], 0.0)
            if x[started] != before:
                break
        assert x[started] == before + 1
        actions.append(action())
    return actions


def counted_actions(chart: CompiledChart, word: tuple[int, ...], num_tasks: int, num_joints: int) -> Actions:
    p = chart.parameters(M=num_tasks, L=num_joints, D0=0).tolist()
    x = chart.initial_state().tolist()
    actions: Actions = []
    decisions = iter(word)
    done = 0.0
    while True:
        u = chart.inputs(done=done, hj=9, nj=9).tolist()
        u[chart.input_index["hj"]] = x[chart.variable_index["l"]]  # the person is always there
        if chart.leaf(x) == "DECIDE":
            a = next(decisions, None)
            if a is None:
                return actions
            u[chart.input_index["a"]] = float(a)
        x, _ = chart.react(x, u, p, 0.0)
        if chart.leaf(x) == "DONE":
            return actions
        kind, index, number, *_ = chart.outputs(x, p)
        if number != done:
            done = number
            if kind in (ActionKind.ROBOT_TASK, ActionKind.PREPARE):
                actions.append(("task" if kind == ActionKind.ROBOT_TASK else "assist", int(index)))


@pytest.mark.parametrize(("num_tasks", "num_joints"), [(3, 2), (4, 3), (1, 1)])
def test_the_same_actions_for_every_word(num_tasks, num_joints, tmp_path):
    path = tmp_path / "literal.scxml"
    path.write_text(literal_chart(num_tasks, num_joints))
    literal, counted = compile_chart(load_chart(path)), shipped("pace_task")
    words = [word for length in range(11) for word in itertools.product((0, 1), repeat=length)]
    assert len(words) == 2047
    lengths = set()
    for word in words:
        actions = literal_actions(literal, word)
        assert actions == counted_actions(counted, word, num_tasks, num_joints)
        lengths.add(len(actions))
    assert max(lengths) == 11
