"""Inbox: only good and newer messages become the newest, whatever else is on the channel."""

import pytest
from drake import lcmt_panda_status
from pydrake.lcm import DrakeLcm

from pace_drake.lcm.inbox import Inbox
from pace_drake.lcm.types import lcmt_pace_decision, lcmt_pace_hand
from tests.lcm.senders import hand, vandalised


@pytest.fixture
def lcm():
    return DrakeLcm("memq://")


def by_sequence(lcm, **kwargs):
    return Inbox(lcm, "C", lcmt_pace_hand, stamp=lambda message: message.sequence, restart=100, **kwargs)


def send(lcm, *messages):
    for message in messages:
        lcm.Publish("C", message)
        lcm.HandleSubscriptions(0)


def counts(dut):
    return dut.num_good, dut.num_old, dut.num_bad


def test_newest_of_several_is_kept_and_all_are_counted(lcm):
    dut = by_sequence(lcm)
    assert dut.newest is None
    send(lcm, hand(1), hand(2), hand(3))
    assert dut.newest.sequence == 3
    assert counts(dut) == (3, 0, 0)


def test_duplicates_and_late_ones_are_dropped(lcm):
    dut = by_sequence(lcm)
    send(lcm, hand(1), hand(3, (1.0, 0.0, 0.0)), hand(3), hand(2), hand(1))
    assert dut.newest.sequence == 3
    assert dut.newest.p_WH[0] == 1.0
    assert counts(dut) == (2, 3, 0)


def test_a_sender_that_was_started_anew_is_taken(lcm):
    dut = by_sequence(lcm)
    send(lcm, hand(1101), hand(1001))
    assert dut.newest.sequence == 1101
    send(lcm, hand(1000))
    assert dut.newest.sequence == 1000
    send(lcm, hand(1001))
    assert counts(dut) == (3, 1, 0)


def test_by_default_time_decides_and_a_second_back_is_a_new_clock(lcm):
    dut = Inbox(lcm, "C", lcmt_pace_hand)
    send(lcm, hand(9, utime=5_000_000), hand(1, utime=4_000_000))
    assert dut.newest.utime == 5_000_000
    send(lcm, hand(1, utime=3_999_999), hand(1, utime=4_000_001))
    assert dut.newest.utime == 4_000_001


def test_what_the_check_refuses_is_dropped_with_its_reason(lcm):
    dut = by_sequence(lcm, check=lambda message: "" if message.p_WH[0] > 0 else "is behind the world")
    send(lcm, hand(1), hand(2, (-1.0, 0.0, 0.0)))
    assert dut.newest.sequence == 1
    assert counts(dut) == (1, 0, 1)
    assert dut.last_bad == "is behind the world"
    # What is refused does not count as seen either.
    send(lcm, hand(2))
    assert dut.newest.sequence == 2


def test_another_channel_is_another_matter(lcm):
    dut = by_sequence(lcm)
    lcm.Publish("D", hand(1))
    lcm.HandleSubscriptions(0)
    assert dut.newest is None


@pytest.mark.parametrize("lcm_type", [lcmt_pace_hand, lcmt_pace_decision, lcmt_panda_status])
def test_vandals_do_no_harm(lcm, lcm_type):
    dut = Inbox(lcm, "C", lcm_type, check=lambda message: "" if message.utime == 42 else "is not mine")
    good = lcm_type()
    good.utime = 42
    send(lcm, good.encode())
    sent, good_before = 10_000, dut.num_good
    for data in vandalised([good.encode()], sent):
        send(lcm, data)
        assert dut.newest.utime == 42
    assert dut.num_bad > sent / 2
    assert sum(counts(dut)) == sent + good_before
    assert dut.last_bad
