"""OperatorReceiver: every press counts, and every reader can see it."""

from itertools import pairwise

import pytest

from pace_drake.lcm.types import lcmt_pace_operator
from pace_drake.systems.operator_receiver import ACK_GAP, STOP_HOLD, OperatorReceiver
from tests.lcm.senders import press
from tests.systems.stepped import Stepped

REQUEST, STOP, ACKNOWLEDGE = lcmt_pace_operator.REQUEST, lcmt_pace_operator.STOP, lcmt_pace_operator.ACKNOWLEDGE


class Bench(Stepped):
    def __init__(self):
        super().__init__(OperatorReceiver)
        self.num = 0

    def press(self, *events):
        for event in events:
            self.num += 1
            self.send("PACE_OPERATOR", press(event, self.num))

    def at(self, time):
        self.advance(time)
        return self["stop"], self["ack"], self["button"]


@pytest.fixture
def dut():
    return Bench()


def test_nothing_is_pressed(dut):
    dut.initialize()
    assert dut.at(1.0) == (0, 0, 0)


def test_a_stop_stands_until_it_is_acknowledged(dut):
    dut.initialize()
    dut.press(STOP)
    assert dut["stop"] == 0  # state alone is put out
    assert dut.at(0.01) == (1, 0, 0)
    assert dut.at(100.0) == (1, 0, 0)
    dut.press(ACKNOWLEDGE)
    assert dut.at(100.0 + ACK_GAP + 0.01) == (0, 1, 0)
    assert dut.at(100.0 + ACK_GAP + 0.49) == (0, 1, 0)
    assert dut.at(100.0 + ACK_GAP + 0.51) == (0, 0, 0)


def test_all_requests_between_two_steps_count(dut):
    dut.initialize()
    dut.press(REQUEST, REQUEST, REQUEST)
    assert dut.at(0.01) == (0, 0, 3)
    dut.press(REQUEST)
    assert dut.at(0.02) == (0, 0, 4)
    assert dut.at(0.03) == (0, 0, 4)


def test_a_stop_that_is_acknowledged_at_once_is_seen_before_the_acknowledgement(dut):
    dut.initialize()
    dut.press(STOP, ACKNOWLEDGE)
    seen = [dut.at(0.01 * k)[:2] for k in range(1, 60)]
    assert seen[0] == (1, 0)
    assert (0, 1) in seen
    assert sum(stop for stop, _ in seen) == pytest.approx(STOP_HOLD / 0.01, abs=1)
    assert seen[-1] == (0, 0)


def test_a_stop_after_an_acknowledgement_stands(dut):
    dut.initialize()
    dut.press(STOP, ACKNOWLEDGE, STOP)
    assert dut.at(1.0)[0] == 1


def test_two_acknowledgements_give_two_rising_edges(dut):
    dut.initialize()
    dut.press(ACKNOWLEDGE)
    levels = []
    for k in range(1, 200):
        if k == 20:
            dut.press(ACKNOWLEDGE)
        levels.append(dut.at(0.01 * k)[1])
    edges = sum(after > before for before, after in pairwise(levels))
    assert edges == 2


def test_of_what_was_pressed_before_the_start_only_a_stop_counts(dut):
    dut.press(REQUEST, STOP)
    dut.initialize()
    assert dut["stop"] == 1
    assert dut.at(0.2) == (1, 0, 0)
    dut.press(ACKNOWLEDGE)
    dut.initialize()
    assert dut.at(0.2) == (0, 0, 0)
    dut.press(REQUEST)
    assert dut.at(0.3) == (0, 0, 1)


def test_no_bytes_do_harm(dut):
    dut.initialize()
    dut.send("PACE_OPERATOR", b"", b"stop", press(STOP, 1)[:-1], press(9, 1))
    assert dut.at(0.5) == (0, 0, 0)
    assert dut.dut.inbox.num_bad == 4
