"""LcmLink: one participant's view of an LCM."""

import pytest
from pydrake.lcm import DrakeLcm

from pace_drake.lcm.link import LcmLink


@pytest.fixture
def lcm():
    return DrakeLcm("memq://")


def test_one_does_not_hear_oneself_and_hears_all_others(lcm):
    dut, other = LcmLink(lcm), LcmLink(lcm)
    heard, heard_by_other = [], []
    dut.Subscribe("C", heard.append)
    other.Subscribe("C", heard_by_other.append)
    for k in range(5):
        dut.Publish("C", b"mine %d" % k)
        other.Publish("C", b"theirs %d" % k)
        lcm.HandleSubscriptions(0)
    assert heard == [b"theirs %d" % k for k in range(5)]
    assert heard_by_other == [b"mine %d" % k for k in range(5)]


def test_bytes_sent_on_one_channel_are_heard_on_another(lcm):
    dut, heard = LcmLink(lcm), []
    dut.Subscribe("D", heard.append)
    dut.Publish("C", b"same")
    lcm.Publish("D", b"same")
    lcm.HandleSubscriptions(0)
    assert heard == [b"same"]


def test_the_tap_sees_each_message_once(lcm):
    tapped, heard = [], []
    dut = LcmLink(lcm, lambda channel, data: tapped.append((channel, data)))
    dut.Subscribe("C", heard.append)
    dut.Publish("C", b"mine")
    lcm.HandleSubscriptions(0)
    lcm.Publish("C", b"theirs")
    lcm.HandleSubscriptions(0)
    dut.Publish("D", b"to nobody")
    lcm.HandleSubscriptions(0)
    assert tapped == [("C", b"mine"), ("C", b"theirs"), ("D", b"to nobody")]
    assert heard == [b"theirs"]


def test_an_echo_that_comes_late_is_still_an_echo(lcm):
    dut, heard = LcmLink(lcm), []
    dut.Subscribe("C", heard.append)
    for k in range(500):
        dut.Publish("C", b"%d" % k)
    lcm.HandleSubscriptions(0)
    assert heard == []
