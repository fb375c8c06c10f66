"""Simulated robots by others, and the driver on them, as processes of their own."""

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.network import own_url, why_not

CHECKOUT = Path(__file__).parents[2]
FRANKY, FRANKA = CHECKOUT / ".venv-franky", CHECKOUT / ".venv-franka"
PACE = [sys.executable, "-m", "pace_drake.cli.main"]


def environment() -> dict[str, str]:
    """That of a process which may use the network, unlike the tests themselves."""
    return {name: value for name, value in os.environ.items() if name != "DRAKE_ALLOW_NETWORK"}


def free_address(number: int) -> str:
    """Returns an address of this machine on which nobody is a robot: the port is always 1337."""
    for attempt in range(50):
        address = f"127.0.{number}.{(os.getpid() + attempt) % 250 + 1}"
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with contextlib.suppress(OSError):
                probe.bind((address, 1337))
                return address
    pytest.skip("no free address for a simulated robot")


@contextlib.contextmanager
def running(command: list[str], log: Path, ready: Callable[[], bool]) -> Iterator[subprocess.Popen]:
    """Runs a process until the end of the block, which begins when it is ready."""
    with log.open("w") as out, subprocess.Popen(command, stdout=out, stderr=out, env=environment()) as process:
        try:
            until(lambda: process.poll() is not None or ready(), 60.0)
            assert process.poll() is None, log.read_text()[-2000:]
            yield process
        finally:
            process.terminate()
            try:
                process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                process.kill()


def until(condition: Callable[[], bool], timeout: float) -> bool:
    """Waits, at most so long [s], and says whether it came."""
    end = time.monotonic() + timeout
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def answers(address: str) -> bool:
    """Whether a robot does there."""
    with contextlib.suppress(OSError), socket.create_connection((address, 1337), timeout=1.0):
        return True
    return False


def available(*environments: Path) -> str:
    """A URL for a simulated robot and its driver; skips the test, with the reason, where there can be none."""
    pytest.importorskip("pylibfranka", reason="needs the extra 'driver'")
    pytest.importorskip("panda_py", reason="needs the extra 'driver'")
    for environment in environments:
        if not (environment / "installed").exists():
            pytest.skip(f"no {environment.name} here: make peers")
    url = own_url()
    if reason := why_not(url):
        pytest.skip(reason)
    return url


def franky_sim() -> tuple[list[str], str]:
    """Starts franky-sim: a command, and the robot's address."""
    address = free_address(101)
    return [str(FRANKY / "bin/franky-sim"), "-s", "mujoco", "--hostname", address], address


def franka_sim(*options: str) -> tuple[list[str], str]:
    """Starts franka-sim: a command, and the robot's address."""
    address = free_address(102)
    script = str(CHECKOUT / "tests/peers/start_franka_sim.py")
    return [str(FRANKA / "bin/python"), script, address, str(FRANKY), *options], address


def driver(address: str, url: str, *options: str) -> list[str]:
    """Starts the driver on it."""
    return [*PACE, "driver", "--robot", "fr3", "--ip", address, "--lcm-url", url, "--no-realtime", *options]
