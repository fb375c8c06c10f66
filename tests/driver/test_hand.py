import threading
import time

import pytest
from drake import lcmt_schunk_wsg_command, lcmt_schunk_wsg_status
from hypothesis import given
from hypothesis import strategies as st
from pydrake.lcm import DrakeLcm

from pace_drake.driver import hand as dut
from pace_drake.driver.robot import ConnectionLost, MotionAborted
from pace_drake.lcm.config import LcmConfig


class FakeHand:
    """Is at once where it is told to be, unless ``blocked``; then it moves until it is stopped."""

    def __init__(self) -> None:
        self.width, self.grasped = 0.04, False
        self.calls: list[tuple] = []
        self.blocked = False
        self.stopped = threading.Event()
        self.error: Exception | None = None

    def connect(self) -> None:
        self.calls.append(("connect",))

    def read(self) -> dut.HandState:
        return dut.HandState(self.width, self.grasped)

    def move(self, width: float, speed: float) -> None:
        self._go("move", width)

    def grasp(self, width: float, speed: float, force: float) -> None:
        self._go("grasp", width, force)
        self.grasped = True

    def stop(self) -> None:
        self.calls.append(("stop",))
        self.stopped.set()

    def _go(self, name: str, width: float, *force: float) -> None:
        self.calls.append((name, width, *force))
        if self.error:
            raise self.error
        if self.blocked:
            self.stopped.wait(5.0)
        else:
            self.width = width


class Rig:
    def __init__(self) -> None:
        self.hand, self.lcm, self.reports, self.statuses = FakeHand(), DrakeLcm("memq://"), [], []
        self.driver = dut.HandDriver(self.hand, self.lcm, channels=LcmConfig(), report=self.reports.append)
        self.lcm.Subscribe("PANDA_HAND_STATUS", lambda data: self.statuses.append(lcmt_schunk_wsg_status.decode(data)))
        self.utime = 0

    def command(self, width_mm: float, force: float = 40.0) -> None:
        message = lcmt_schunk_wsg_command()
        self.utime += 1
        message.utime, message.target_position_mm, message.force = self.utime, width_mm, force
        self.lcm.Publish("PANDA_HAND_COMMAND", message.encode())
        self.step()

    def step(self) -> None:
        self.driver.step()
        if self.driver._motion is not None and not self.hand.blocked:
            self.driver._motion.join(timeout=5.0)
        self.lcm.HandleSubscriptions(0)


def test_opening_moves_closing_grasps_and_repetitions_are_ignored():
    rig = Rig()
    for width in (80.0, 80.0, 80.0, 10.0, 10.0, 80.0):
        rig.command(width)
    assert rig.hand.calls == [("move", 0.08), ("grasp", 0.01, 40.0), ("move", 0.08)]
    rig.command(80.0, force=20.0)
    assert rig.hand.calls[3:] == [("move", 0.08)]


def test_status_has_width_speed_and_force():
    rig = Rig()
    rig.step()
    assert (rig.statuses[-1].actual_position_mm, rig.statuses[-1].actual_speed_mm_per_s) == (40.0, 0.0)
    assert rig.statuses[-1].actual_force == 0.0
    rig.command(30.0)
    rig.step()
    assert rig.statuses[-1].actual_position_mm == 30.0
    assert rig.statuses[-1].actual_speed_mm_per_s == pytest.approx(-100.0)
    assert rig.statuses[-1].actual_force == 40.0


def test_a_new_command_ends_the_motion_under_way_and_status_goes_on_meanwhile():
    rig = Rig()
    rig.hand.blocked = True
    rig.command(80.0)
    for _ in range(3):
        rig.step()
    assert len(rig.statuses) == 4
    rig.hand.blocked = False
    rig.command(0.0)
    assert [call[0] for call in rig.hand.calls] == ["move", "stop", "grasp"]


@pytest.mark.parametrize(
    ("width", "force", "why"),
    [
        (81.0, 40.0, "width 81 mm"),
        (-1.0, 40.0, "width -1 mm"),
        (float("nan"), 40.0, "width nan"),
        (10.0, float("nan"), "force nan"),
        (10.0, -1.0, "force -1 N"),
        (10.0, 141.0, "force 141 N"),
    ],
)
def test_what_cannot_be_done_is_dropped(width, force, why):
    rig = Rig()
    rig.command(width, force)
    assert rig.hand.calls == []
    assert why in rig.reports[0]
    rig.command(10.0)
    assert rig.hand.calls == [("grasp", 0.01, 40.0)]


@given(st.binary(max_size=60))
def test_corrupted_bytes_never_raise(noise):
    rig = Rig()
    rig.lcm.Publish("PANDA_HAND_COMMAND", noise)
    rig.step()
    assert rig.hand.calls == []


def test_a_motion_that_fails_is_reported():
    rig = Rig()
    rig.hand.error = MotionAborted("no object")
    rig.command(10.0)
    assert rig.reports == ["the hand did not reach 10 mm: no object"]


def test_a_lost_hand_is_reported_once_and_tried_again(monkeypatch):
    monkeypatch.setattr(dut, "_PERIOD", 0.001)
    monkeypatch.setattr(dut, "_RECONNECT", 0.002)
    rig = Rig()
    tries = []

    def connect() -> None:
        tries.append(1)
        if len(tries) < 4:
            raise ConnectionLost("refused")

    rig.hand.connect = connect  # type: ignore[method-assign]
    rig.driver.run(lambda: rig.driver._last is not None)
    assert rig.reports[0] == "no connection to the hand (refused); trying on, --hand none does without"
    assert rig.reports[1:] == ["connected to the hand again"]
    assert len(tries) == 4


def test_the_simulated_hand_moves_at_a_finite_speed_and_can_be_stopped():
    hand = dut.SimulatedHand(0.08)
    thread = threading.Thread(target=hand.move, args=(0.0, 0.1))
    thread.start()
    time.sleep(0.1)
    hand.stop()
    thread.join(timeout=5.0)
    assert 0.0 < hand.read().width < 0.08
    hand.move(0.079, 1.0)
    assert hand.read() == dut.HandState(0.079, False)
