"""TaskStatechart: ports, chains within one update, decisions."""

import numpy as np
import pytest

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.statechart import compile_chart, load_chart
from pace_drake.systems.task_statechart import TaskStatechart
from pace_drake.task import ActionKind
from tests.systems.forced import force_update

CHART = "statecharts/pace_task.scxml"


@pytest.fixture(scope="module")
def dut():
    compiled = compile_chart(load_chart(resource_path(CHART)))
    return TaskStatechart(compiled, compiled.parameters(), compiled.initial_state(i=4))


@pytest.fixture
def context(dut):
    return dut.CreateDefaultContext()


def update(dut, context, time=None, **inputs):
    if time is not None:
        context.SetTime(time)
    for name, value in inputs.items():
        dut.GetInputPort(name).FixValue(context, float(value))
    force_update(dut, context)
    return dut.fired(context)


def out(dut, context, name):
    value = dut.GetOutputPort(name).Eval(context)
    return value[0] if len(value) == 1 else list(value)


def test_a_chain_of_reactions_takes_one_update(dut, context):
    assert out(dut, context, "decision_pending") == 1  # with nothing connected it starts
    assert out(dut, context, "robot_task") == 4
    assert update(dut, context, assist=0) == ["t_start", "r_done", "d_no"]
    assert out(dut, context, "robot_action") == [ActionKind.ROBOT_TASK, 1, 1]
    assert out(dut, context, "decision_pending") == 0
    assert out(dut, context, "decision_index") == 1


def test_pending_does_not_depend_on_the_answer(dut):
    for answer in (-1, 0, 1):
        context = dut.CreateDefaultContext()  # else a cached value would do
        dut.GetInputPort("assist").FixValue(context, float(answer))
        assert out(dut, context, "decision_pending") == 1


@pytest.mark.parametrize("answer", [-1.0, 0.5, 2.0, np.nan])
def test_what_is_no_answer_leaves_the_decision_open(dut, context, answer):
    assert update(dut, context, assist=answer) == ["t_start", "r_done"]
    assert out(dut, context, "next_event_time") == 1.0
    assert update(dut, context, time=0.5, assist=answer) == []
    answered = context.Clone()
    assert update(dut, answered, time=0.7, assist=1) == ["d_yes"]
    assert update(dut, context, time=1.0, assist=answer) == ["d_timeout"]  # as no answer, not as one of its own


def test_an_assistance(dut, context):
    update(dut, context, assist=1)
    assert out(dut, context, "robot_action") == [ActionKind.PREPARE, 1, 1]
    update(dut, context, time=11.0, done=1)
    assert out(dut, context, "robot_waiting") == 1
    assert out(dut, context, "joint_ready") == 0
    assert out(dut, context, "robot_action") == [ActionKind.NONE, 0, 1]
    update(dut, context, time=15.0, hj=1)
    assert out(dut, context, "robot_waiting") == 0
    assert out(dut, context, "joint_ready") == 1
    update(dut, context, time=25.0, done=2, nj=1)
    assert out(dut, context, "robot_action") == [ActionKind.HOME, 1, 3]
    assert update(dut, context, time=30.0, done=3, assist=1) == ["h_next", "d_yes"]  # again, directly after homing
    assert out(dut, context, "robot_action") == [ActionKind.PREPARE, 2, 4]
    assert out(dut, context, "finished") == 0


def test_stopped_it_tells_the_robot_to_hold(dut, context):
    update(dut, context, assist=0)
    assert update(dut, context, stop=1) == ["t_stop"]
    assert out(dut, context, "robot_action")[0] == ActionKind.HOLD


def test_homing_after_an_abort_is_another_motion():
    compiled = compile_chart(load_chart(resource_path(CHART)))
    dut = TaskStatechart(compiled, compiled.parameters(Twait=2.0), compiled.initial_state())
    context = dut.CreateDefaultContext()
    update(dut, context, assist=1)
    update(dut, context, time=10.0, done=1)
    assert out(dut, context, "next_event_time") == 12.0
    assert update(dut, context, time=12.0) == ["w_abort"]
    assert out(dut, context, "robot_action") == [ActionKind.HOME_ABORTED, 1, 2]


D_NO = """<transition pace:id="d_no" cond="a == 0" target="ROBOT_TASK">
        <assign location="i" expr="i % M + 1"/>
        <assign location="cmd" expr="cmd + 1"/>"""


def write(tmp_path, old, new):
    path = tmp_path / "chart.scxml"
    text = resource_path(CHART).read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return path


def make(path):
    compiled = compile_chart(load_chart(path))
    return TaskStatechart(compiled, compiled.parameters(), compiled.initial_state())


def test_a_chart_that_does_not_come_to_rest_says_so(tmp_path):
    # DECIDE times out at once into ROBOT_TASK, which counts as done at once.
    path = write(tmp_path, "a == -1 &amp;&amp; now &gt;= t0 + Tdec", "a == -1")
    path.write_text(path.read_text().replace('id="r_done" cond="done == cmd"', 'id="r_done" cond="done &lt;= cmd"'))
    dut = make(path)
    with pytest.raises(RuntimeError, match="does not come to rest"):
        update(dut, dut.CreateDefaultContext())


def test_a_chain_reads_the_decision_once(tmp_path):
    # Going on issues no new command here, so the chain comes to DECIDE a second time.
    dut = make(write(tmp_path, D_NO, D_NO.replace('<assign location="cmd" expr="cmd + 1"/>', "")))
    context = dut.CreateDefaultContext()
    assert update(dut, context, assist=0) == ["t_start", "r_done", "d_no", "r_done"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"HOME_KIND" expr="4"', '"HOME_KIND" expr="9"', "HOME_KIND = 9 is no action kind; known are NONE_KIND 0"),
        ('id="decision_index"', 'id="decisions"', "it lacks outputs decision_index; begin with a copy of pace_task"),
    ],
)
def test_a_chart_that_is_no_task_chart_is_refused(tmp_path, old, new, message):
    with pytest.raises(InputError, match=message):
        make(write(tmp_path, old, new))
