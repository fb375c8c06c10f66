"""The driver as a process of its own, against simulated robots by others, over LCM. Nothing here measures a time."""

import contextlib
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from drake import lcmt_panda_status, lcmt_schunk_wsg_command, lcmt_schunk_wsg_status

from tests.driver.fake import make_command
from tests.peers.processes import FRANKA, FRANKY, answers, available, driver, franka_sim, franky_sim, running

pytestmark = [pytest.mark.slow, pytest.mark.hardware, pytest.mark.alone]

MOVE, REFLEX = lcmt_panda_status.kMove, lcmt_panda_status.kReflex


class Sender:
    """Somebody who moves the robot over LCM, as users of the TRI driver do."""

    def __init__(self, url: str) -> None:
        from lcm import LCM

        self._lcm = LCM(url)
        self.statuses: list[lcmt_panda_status] = []
        self.widths: list[float] = []
        self._lcm.subscribe(
            "PANDA_STATUS", lambda _, data: self.statuses.append(lcmt_panda_status.decode(data))
        ).set_queue_capacity(5000)
        self._lcm.subscribe(
            "PANDA_HAND_STATUS",
            lambda _, data: self.widths.append(1e-3 * lcmt_schunk_wsg_status.decode(data).actual_position_mm),
        )

    def listen(self, duration: float) -> None:
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0:
            self._lcm.handle_timeout(max(1, round(1e3 * left)))

    def listen_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        end = time.monotonic() + timeout
        while time.monotonic() < end and not condition():
            self.listen(0.02)
        return condition()

    @property
    def mode(self) -> int:
        return self.statuses[-1].robot_mode if self.statuses else -1

    @property
    def position(self) -> np.ndarray:
        return np.array(self.statuses[-1].joint_position)

    def move(self, distance: np.ndarray, duration: float) -> float:
        """Moves by a distance (7) [rad] and back to rest; returns the largest |measured - commanded| [rad].

        It ends early when the robot is not under control any more.
        """
        start, begin, error = np.array(self.statuses[-1].joint_position_desired), time.monotonic(), 0.0
        while (elapsed := time.monotonic() - begin) < duration + 0.5 and self.mode == MOVE:
            share = min(1.0, elapsed / duration)
            goal = start + distance * (10 * share**3 - 15 * share**4 + 6 * share**5)
            self._lcm.publish("PANDA_COMMAND", make_command(round(1e6 * time.time()), goal).encode())
            self.listen(0.005)
            error = max(error, float(np.abs(self.position - goal).max()))
        return error

    def hand(self, width: float) -> None:
        message = lcmt_schunk_wsg_command()
        message.utime, message.target_position_mm, message.force = round(1e6 * time.time()), 1e3 * width, 40.0
        self._lcm.publish("PANDA_HAND_COMMAND", message.encode())


@contextlib.contextmanager
def driven(peer: tuple[list[str], str], url: str, folder: Path) -> Iterator[tuple[Sender, subprocess.Popen]]:
    """Runs a simulated robot and the driver on it."""
    command, address = peer
    sender = Sender(url)
    with (
        running(command, folder / "peer.log", lambda: answers(address)),
        running(
            driver(address, url), folder / "driver.log", lambda: sender.listen(0.05) or sender.mode == MOVE
        ) as process,
    ):
        yield sender, process


@pytest.fixture
def franky(tmp_path: Path) -> Iterator[tuple[Sender, subprocess.Popen]]:
    url = available(FRANKY)
    with driven(franky_sim(), url, tmp_path) as both:
        yield both


@pytest.fixture
def franka(tmp_path: Path) -> Iterator[tuple[Sender, subprocess.Popen]]:
    url = available(FRANKY, FRANKA)
    with driven(franka_sim(), url, tmp_path) as both:
        yield both


def test_franky_sim_moves_and_its_hand_too(franky, tmp_path, capsys):
    sender, process = franky
    start = sender.position
    error = sender.move(np.full(7, 0.3), 3.0)
    with capsys.disabled():
        print(f"\nfranky-sim: 0.3 rad in 3 s, largest joint error {error:.4f} rad")
    # Its joints are soft: they trail by 0.1 s, which is 19 mrad here, when commanded without any driver as well.
    assert error < 0.1
    np.testing.assert_allclose(sender.position, start + 0.3, atol=0.02)
    assert sender.statuses[-1].control_mode == lcmt_panda_status.CONTROL_MODE_POSITION
    for width in (0.01, 0.07):
        sender.hand(width)
        assert sender.listen_until(lambda width=width: abs(sender.widths[-1] - width) < 0.01, 20.0)
    assert sender.mode == MOVE
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=20.0) == 130
    assert (tmp_path / "driver.log").read_text().splitlines()[-1] == "pace: interrupted; the robot stands still"


def test_franka_sim_reflex_recovery_and_moving_again(franka, tmp_path, capsys):
    sender, process = franka
    error = sender.move(np.full(7, 0.1), 2.0)
    with capsys.disabled():
        print(f"\nfranka-sim: 0.1 rad in 2 s, largest joint error {error:.4f} rad")
    # Its hand is heard beside the arm, whose control loop leaves other threads little time.
    sender.widths.clear()
    assert sender.listen_until(lambda: len(sender.widths) > 5, 20.0)
    # What brings about the reflex that a busy computer does: commands fail to come for more than 20 ms.
    process.send_signal(signal.SIGSTOP)
    time.sleep(0.3)
    process.send_signal(signal.SIGCONT)
    assert sender.listen_until(lambda: sender.mode == REFLEX, 20.0)
    assert sender.listen_until(lambda: sender.mode == MOVE, 20.0)
    held = sender.position
    sender.listen(0.5)
    np.testing.assert_allclose(sender.position, held, atol=0.005)
    # A busy computer may bring about another one: then from there, some times.
    for _ in range(5):
        start = sender.position
        sender.move(np.full(7, -0.1), 2.0)
        if sender.mode == MOVE:
            break
        assert sender.listen_until(lambda: sender.mode == MOVE, 20.0)
    np.testing.assert_allclose(sender.position, start - 0.1, atol=0.02)
    text = (tmp_path / "driver.log").read_text()
    assert "communication_constraints_violation" in text
    assert "recovered; holding the measured position" in text
    assert "Traceback" not in text
    process.terminate()
    assert process.wait(timeout=20.0) == 0
