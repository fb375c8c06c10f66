"""pace_drake.statechart.compile: the semantics of one reaction, on the chart of the paper."""

import numpy as np
import pytest

from pace_drake.resources import resource_path
from pace_drake.statechart import compile_chart, load_chart


@pytest.fixture(scope="module")
def chart():
    return compile_chart(load_chart(resource_path("statecharts/pace_task.scxml")))


class Run:
    """Drives the compiled chart by hand."""

    def __init__(self, chart, **parameters):
        self.chart = chart
        self.x = chart.initial_state()
        self.p = chart.parameters(**parameters)
        self.time = 0.0

    def react(self, **inputs):
        before = self.x.copy()
        new, fired = self.chart.react(self.x, self.chart.inputs(**inputs), self.p, self.time)
        assert np.array_equal(self.x, before)  # pure
        self.x = new
        return self.chart.chart.transitions[fired].id if fired >= 0 else None

    @property
    def leaf(self):
        return self.chart.leaf(self.x)

    def get(self, name):
        return self.x[self.chart.variable_index[name]]


def at_decision(chart, **parameters):
    run = Run(chart, **parameters)
    assert [run.react(), run.react()] == ["t_start", "r_done"]
    return run


def test_the_first_decision_is_at_the_start_with_the_last_robot_task(chart):
    run = at_decision(chart, M=4)
    assert run.leaf == "DECIDE"
    assert run.get("i") == 4
    assert run.react(a=0) == "d_no"
    assert (run.get("i"), run.get("cmd")) == (1, 1)


def test_as_printed_it_starts_with_robot_task_one(chart):
    run = Run(chart, D0=0)
    assert run.react() == "t_start"
    assert (run.leaf, run.get("i"), run.get("cmd")) == ("ROBOT_TASK", 1, 1)
    assert run.react(done=0) is None
    assert run.react(done=1) == "r_done"


def test_a_robot_task_follows_the_one_before_and_assisting_leaves_it_where_it_was(chart):
    run = at_decision(chart, M=2)
    run.react(a=0)
    run.react(done=1)
    run.react(a=0)
    assert run.get("i") == 2
    run.react(done=2)
    assert run.react(a=1, done=2) == "d_yes"
    assert (run.leaf, run.get("i"), run.get("cmd")) == ("PREP", 2, 3)


def test_the_robot_waits_for_the_person_and_counts_it(chart):
    run = at_decision(chart)
    run.react(a=1)
    run.time = 11.0
    assert run.react(done=1, hj=0) == "p_wait"
    run.time = 14.5
    assert run.react(done=1, hj=0) is None
    assert run.react(done=1, hj=1) == "w_joint"
    assert run.get("rI") == pytest.approx(3.5)
    assert run.react(done=2, nj=0) is None
    assert run.react(done=2, nj=1) == "j_done"
    assert run.react(done=3, nj=1) == "h_next"
    assert (run.leaf, run.get("l"), run.get("d")) == ("DECIDE", 2, 2)


def test_the_person_waits_and_the_robot_joins_at_once(chart):
    run = at_decision(chart)
    run.react(a=1)
    assert run.react(done=1, hj=1) == "p_joint"
    assert run.get("rI") == 0


def test_the_end_and_rearming(chart):
    run = at_decision(chart, L=1)
    run.react(a=1)
    run.react(done=1, hj=1)
    run.react(done=2, nj=1)
    assert run.react(done=3) == "h_end"
    assert run.leaf == "DONE"
    assert run.react(start=0) == "e_rearm"
    assert run.react(start=1, done=3) == "t_start"
    assert run.get("l") == 1


def test_a_decision_without_an_answer_times_out(chart):
    run = at_decision(chart, Tdec=1.0)
    run.time = 0.999
    assert run.react(a=-1) is None
    assert chart.next_deadline(run.x, chart.inputs(), run.p, run.time) == 1.0
    run.time = 1.0
    assert run.react(a=-1) == "d_timeout"
    assert run.leaf == "ROBOT_TASK"
    assert chart.next_deadline(run.x, chart.inputs(), run.p, run.time) == np.inf


def test_waiting_too_long_aborts_and_decides_again_about_the_same_joint_action(chart):
    run = at_decision(chart, Twait=5.0)
    run.react(a=1)
    run.react(done=1)
    assert chart.next_deadline(run.x, chart.inputs(), run.p, run.time) == 5.0
    run.time = 5.0
    assert run.react(done=1) == "w_abort"
    assert run.get("ab") == 1
    assert run.react(done=2) == "h_aborted"
    assert (run.leaf, run.get("l"), run.get("ab")) == ("DECIDE", 1, 0)


def test_stop_preempts_and_resume_returns_to_where_it_was(chart):
    run = at_decision(chart)
    run.react(a=1)
    run.react(done=1)  # WAIT
    run.time = 2.0
    assert run.react(stop=1, done=1, hj=1) == "t_stop"  # preempts w_joint, which is enabled too
    assert run.leaf == "STOPPED"
    run.time = 10.0
    assert run.react(ack=1, rb=1, done=1) is None  # the arm still moves
    assert run.react(ack=1, rb=0, done=1) == "s_resume"
    assert run.leaf == "WAIT"
    run.time = 11.0
    assert run.react(done=1, hj=1) == "w_joint"
    assert run.get("rI") == pytest.approx(3.0)  # the timer stood still while stopped


def test_an_interrupted_command_is_issued_again_with_a_new_number(chart):
    run = at_decision(chart)
    run.react(a=0)
    assert run.react(stop=1, done=0) == "t_stop"
    assert run.react(ack=1, done=0) == "s_reissue"
    assert (run.leaf, run.get("cmd"), run.get("i")) == ("ROBOT_TASK", 2, 1)
    assert run.react(done=1) is None
    assert run.react(done=2) == "r_done"


def test_fault_is_above_stop_and_needs_two_steps_back(chart):
    run = at_decision(chart)
    run.react(a=0)
    assert run.react(stop=1, fault=1) == "t_fault"
    assert run.react(fault=1, ack=1) is None
    assert run.react(ack=1) == "f_ack"
    assert run.react(fault=1) == "s_fault"


def test_a_reset_forgets_history_of_an_earlier_run(chart):
    run = at_decision(chart, L=1)
    run.react(a=1)
    run.react(stop=1)
    run.react(ack=1)
    assert run.leaf == "PREP"
    run.react(done=2, hj=1)
    run.react(done=3, nj=1)
    run.react(done=4)
    run.react(start=0)
    assert run.react(start=1, done=4) == "t_start"
    assert run.leaf == "ROBOT_TASK"
