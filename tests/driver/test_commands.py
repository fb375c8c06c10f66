import re

import numpy as np
import pytest
from drake import lcmt_panda_status
from hypothesis import given
from hypothesis import strategies as st
from pydrake.lcm import DrakeLcm

from pace_drake.driver.commands import CommandReceiver
from pace_drake.driver.config import DriverConfig
from pace_drake.driver.limits import usable
from pace_drake.safety.joint_limits import JOINT_LIMITS
from tests.driver.fake import EPOCH, START, make_command

FR3 = JOINT_LIMITS["fr3"]

UTIME = round(1e6 * EPOCH)


class Receiver:
    def __init__(self) -> None:
        self.lcm = DrakeLcm("memq://")
        self.now = 0.0
        self.dut = CommandReceiver(
            self.lcm,
            "PANDA_COMMAND",
            usable(FR3),
            DriverConfig(),
            clock=lambda: EPOCH + self.now,
            steady_clock=lambda: self.now,
        )
        self.dut.take(START)
        self.dut.open()

    def gets(self, data: bytes, measured=START):
        self.dut.take(np.array(measured))
        self.lcm.Publish("PANDA_COMMAND", data)
        self.lcm.HandleSubscriptions(0)
        return self.dut.take(np.array(measured))


def test_a_good_command_is_taken_once():
    receiver = Receiver()
    position, stamp = receiver.gets(make_command(UTIME, START + 0.01).encode())
    np.testing.assert_allclose(position, START + 0.01)
    assert stamp == pytest.approx(EPOCH)
    assert receiver.dut.take(START) is None
    assert receiver.dut.num_dropped == 0


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"utime": UTIME - 101_000}, "0.101 s in the past"),
        ({"utime": UTIME + 101_000}, "0.101 s in the future"),
        ({"utime": 0}, "in the past"),
        ({"control_mode_expected": lcmt_panda_status.CONTROL_MODE_VELOCITY}, "control mode 2"),
        ({"control_mode_expected": 0}, "control mode 0"),
        ({"control_mode_expected": 3}, "control mode 3"),
        ({"num_joint_velocity": 7, "joint_velocity": [0.0] * 7}, "7 positions, 7 velocities and 0 torques"),
        ({"num_joint_torque": 7, "joint_torque": [0.0] * 7}, "7 positions, 0 velocities and 7 torques"),
        ({"num_joint_position": 6, "joint_position": list(START[:6])}, "6 positions"),
        ({"num_joint_position": 0, "joint_position": []}, "0 positions"),
        ({"joint_position": [float("nan"), *START[1:]]}, "not a finite number"),
        ({"joint_position": [float("inf"), *START[1:]]}, "not a finite number"),
        ({"joint_position": [2.75, *START[1:]]}, "joint 1 at 2.7500 rad is outside -2.7301 to 2.7301 rad"),
        ({"joint_position": [*START[:3], -0.15, *START[4:]]}, "joint 4"),
        ({"joint_position": [*START[:6], START[6] + 0.06]}, "first command is 0.060 rad from .* at joint 7"),
    ],
)
def test_what_is_dropped_and_why(change, why):
    receiver = Receiver()
    command = make_command(UTIME, START)
    for name, value in change.items():
        setattr(command, name, value)
    assert receiver.gets(command.encode()) is None
    assert receiver.dut.num_dropped == 1
    assert re.search(why, receiver.dut.last_dropped)
    # And the next good one is taken.
    assert receiver.gets(make_command(UTIME, START).encode()) is not None


def test_stamps_within_the_expiry_are_taken():
    for age in (-99_000, 99_000):
        assert Receiver().gets(make_command(UTIME + age, START).encode()) is not None


def test_only_a_first_command_must_be_near():
    receiver = Receiver()
    assert receiver.gets(make_command(UTIME, START).encode()) is not None
    assert receiver.gets(make_command(UTIME + 5_000, START + 0.1).encode()) is not None
    receiver.now = 0.6  # silence
    assert receiver.gets(make_command(UTIME + 600_000, START + 0.1).encode()) is None
    assert receiver.gets(make_command(UTIME + 600_000, START + 0.1).encode(), START + 0.1) is not None
    receiver.dut.close("in reflex")
    receiver.now = 0.605
    assert receiver.gets(make_command(UTIME + 605_000, START + 0.1).encode()) is None
    assert receiver.dut.last_dropped == "in reflex"
    receiver.dut.open()
    assert receiver.gets(make_command(UTIME + 606_000, START + 0.1).encode()) is None
    assert "first command" in receiver.dut.last_dropped


def test_nothing_is_taken_before_it_is_opened():
    receiver = Receiver()
    receiver.dut.close("not yet")
    assert receiver.gets(make_command(UTIME, START).encode()) is None


def test_out_of_order_is_dropped_and_a_clock_set_back_is_no_lock():
    receiver = Receiver()
    assert receiver.gets(make_command(UTIME, START).encode()) is not None
    assert receiver.gets(make_command(UTIME - 1, START).encode()) is None
    assert receiver.gets(make_command(UTIME, START).encode()) is None
    receiver.now = -0.3
    assert receiver.gets(make_command(UTIME - 300_000, START).encode()) is not None


@given(st.binary(max_size=300), st.integers(0, 79))
def test_corrupted_bytes_never_raise(noise, place):
    receiver = Receiver()
    good = make_command(UTIME, START).encode()
    receiver.gets(noise)
    receiver.gets(good[:place])
    receiver.gets(good[:place] + noise + good[place + len(noise) :])
    taken = receiver.gets(make_command(UTIME + 90_000, START).encode())
    assert taken is not None or receiver.dut.num_dropped
