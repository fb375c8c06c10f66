"""OperatorInbox: every press counts, once."""

import pytest
from pydrake.lcm import DrakeLcm

from pace_drake.lcm.operator_inbox import OperatorInbox
from pace_drake.lcm.types import lcmt_pace_operator
from tests.lcm.senders import press, vandalised

REQUEST, STOP, ACKNOWLEDGE = lcmt_pace_operator.REQUEST, lcmt_pace_operator.STOP, lcmt_pace_operator.ACKNOWLEDGE


@pytest.fixture
def lcm():
    return DrakeLcm("memq://")


def send(lcm, *messages):
    for message in messages:
        lcm.Publish("C", message)
        lcm.HandleSubscriptions(0)


def counts(dut):
    return dut.num_request, dut.num_stop, dut.num_ack


def test_presses_are_counted_and_the_last_of_stop_and_acknowledge_stands(lcm):
    dut = OperatorInbox(lcm, "C")
    send(lcm, press(REQUEST, 1), press(STOP, 2))
    assert counts(dut) == (1, 1, 0)
    assert dut.stopped
    send(lcm, press(REQUEST, 3), press(ACKNOWLEDGE, 4))
    assert counts(dut) == (2, 1, 1)
    assert not dut.stopped


def test_a_duplicate_is_no_press(lcm):
    dut = OperatorInbox(lcm, "C")
    send(lcm, press(REQUEST, 1), press(REQUEST, 1), press(REQUEST, 2), press(REQUEST, 1))
    assert counts(dut) == (2, 0, 0)
    assert dut.num_old == 2


def test_no_press_is_lost_to_anothers_clock(lcm):
    dut = OperatorInbox(lcm, "C")
    send(lcm, press(REQUEST, 2_000_000, "person"), press(STOP, 1_999_000, "operator"), press(STOP, 0, "other"))
    assert counts(dut) == (1, 2, 0)


def test_an_unknown_event_is_refused(lcm):
    dut = OperatorInbox(lcm, "C")
    send(lcm, press(0), press(4), press(-1))
    assert counts(dut) == (0, 0, 0)
    assert dut.num_bad == 3
    assert dut.last_bad == "has no event -1"


def test_vandals_do_no_harm(lcm):
    dut = OperatorInbox(lcm, "C")
    good, sent = press(REQUEST, 1), 10_000
    for data in vandalised([good], sent, seed=1):
        send(lcm, data)
    # Bits flipped in stamp or sender, and in the event itself, make other presses; they are counted, no more.
    assert dut.num_bad > sent / 2
    assert sum(counts(dut)) + dut.num_old + dut.num_bad == sent
    before = counts(dut)
    send(lcm, press(REQUEST, 2**40))
    assert dut.num_request == before[0] + 1
