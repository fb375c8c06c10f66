"""HandReceiver: the newest good sample, and how long ago it came."""

from math import inf, nan

import numpy as np
import pytest

from pace_drake.systems.hand_receiver import HandReceiver
from tests.lcm.senders import hand, vandalised
from tests.systems.stepped import Stepped


@pytest.fixture
def dut():
    return Stepped(HandReceiver)


def test_before_the_first_sample_nothing_is_known(dut):
    dut.initialize()
    dut.advance(1.0)
    assert np.isnan(dut["p_WH"]).all()
    assert dut["hand_age"] == inf
    assert dut["num_samples"] == 0


def test_the_newest_sample_is_put_out_and_ages(dut):
    dut.initialize()
    dut.advance(1.0)
    dut.send("PACE_HAND", hand(1, (0.1, 0.2, 0.3)), hand(2, (0.4, 0.5, 0.6)))
    assert dut["hand_age"] == inf  # state alone is put out: until the next step nobody sees it
    dut.advance(1.25)
    assert dut["p_WH"] == [0.4, 0.5, 0.6]
    assert dut["hand_age"] == 0.25  # over-, never underestimated: it came at 1 s or later
    assert dut["num_samples"] == 2
    dut.advance(2.0)
    assert dut["hand_age"] == 1.0


def test_what_is_not_new_does_not_make_the_hand_younger(dut):
    dut.initialize()
    dut.send("PACE_HAND", hand(5, (0.1, 0.2, 0.3)))
    dut.advance(1.0)
    dut.send("PACE_HAND", hand(5, (0.1, 0.2, 0.3)), hand(4))
    dut.advance(2.0)
    assert dut["hand_age"] == 2.0
    assert dut["p_WH"] == [0.1, 0.2, 0.3]
    # The same place under a new number is a hand at rest.
    dut.send("PACE_HAND", hand(6, (0.1, 0.2, 0.3)))
    dut.advance(2.5)
    assert dut["hand_age"] == 0.5


@pytest.mark.parametrize("p_WH", [(nan, 0.0, 0.0), (0.0, inf, 0.0), (0.0, -inf, inf), (0.0, 0.0, 10.1), (850.0, 0, 1)])
def test_a_place_that_cannot_be_is_refused(dut, p_WH):
    dut.initialize()
    dut.send("PACE_HAND", hand(1, p_WH))
    dut.advance(1.0)
    assert dut["hand_age"] == inf
    assert dut.dut.inbox.num_bad == 1
    dut.send("PACE_HAND", hand(2, (0.0, 0.0, -9.9)))
    dut.advance(2.0)
    assert dut["hand_age"] == 1.0


def test_a_sample_from_before_initialization_counts_as_having_come_then(dut):
    dut.send("PACE_HAND", hand(1, (0.1, 0.2, 0.3)))
    dut.initialize()
    assert dut["hand_age"] == 0.0
    assert dut["p_WH"] == [0.1, 0.2, 0.3]


def test_vandals_do_not_move_the_hand(dut):
    dut.initialize()
    good = hand(1, (0.1, 0.2, 0.3))
    dut.send("PACE_HAND", good)
    for k, data in enumerate(vandalised([good], 500)):
        if len(data) < 48:
            dut.send("PACE_HAND", data)
            dut.advance(1e-3 * (k + 1))
    assert dut["p_WH"] == [0.1, 0.2, 0.3]
    assert dut["num_samples"] == 1
