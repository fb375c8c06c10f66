"""pace bridge and pace driver on simulated robots by others, each a process of its own, over LCM. No rate is asserted.

What the bridge says is shown with ``pytest -s``.
"""

import contextlib
import csv
import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from pace_drake.bridge.command_check import check_commands
from pace_drake.bridge.lcm_log import read_log
from pace_drake.scenario import load_scenario
from tests.bridge.conftest import SHORT
from tests.peers.processes import (
    FRANKA,
    FRANKY,
    PACE,
    answers,
    available,
    driver,
    environment,
    franka_sim,
    franky_sim,
    running,
    until,
)

pytestmark = [pytest.mark.slow, pytest.mark.hardware, pytest.mark.alone]

#: This computer may have other things to do, and franky-sim's joints are soft; a lab's has neither excuse.
PATIENT = [
    *("robot=fr3", "status_timeout=1.0", "max_stall=1.0", "max_clock_skew=0.5", "max_tracking_error=1.0"),
    "min_success_rate=0.05",
]
#: What is between the driver's simulated fingers nobody knows.
SETTINGS = [*SHORT, "safety.grasp_check=false", *(f"lcm.{setting}" for setting in PATIENT)]


@dataclass
class Cell:
    """A simulated robot and its driver."""

    url: str
    address: str
    folder: Path

    def driver(self) -> contextlib.AbstractContextManager[subprocess.Popen]:
        log = self.folder / f"driver-{time.monotonic_ns()}.log"
        # The driver says so when it holds the robot.
        return running(driver(self.address, self.url), log, lambda: "holding its position" in log.read_text())


class Bridge:
    """``pace bridge`` in a process, and what it says."""

    def __init__(self, cell: Cell, out: Path, *options: str) -> None:
        self.out, self.log = out, out.with_suffix(".txt")
        command = [
            *PACE,
            "bridge",
            "--lcm-url",
            cell.url,
            "--person",
            "simulated",
            "--yes",
            "--out",
            str(out),
            *options,
        ]
        for setting in SETTINGS:
            command += ["--set", setting]
        with self.log.open("w") as file:
            self.process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=file, stderr=subprocess.STDOUT, env=environment(), text=True
            )

    def __enter__(self) -> "Bridge":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    @property
    def said(self) -> str:
        return self.log.read_text()

    def wait_for(self, text: str, timeout: float = 90.0, count: int = 1) -> None:
        until(lambda: self.said.count(text) >= count or self.process.poll() is not None, timeout)
        assert self.said.count(text) >= count, self.said

    def type(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def end(self, timeout: float) -> int:
        return self.process.wait(timeout)

    def rows(self, kind: str) -> list[dict[str, str]]:
        with (self.out / "events.csv").open(newline="") as file:
            return [row for row in csv.DictReader(file) if row["kind"] == kind]

    def reactions(self) -> list[str]:
        return [row["name"] for row in self.rows("reaction")]

    def acknowledge_until(self, name: str, count: int, timeout: float = 120.0) -> None:
        """Waits for the transition's next time, and acknowledges whatever stops the arm; a busy computer may, too."""
        end, acknowledged = time.monotonic() + timeout, 0.0
        while self.reactions().count(name) < count:
            assert time.monotonic() < end, self.said
            assert self.process.poll() is None, self.said
            if self.reactions()[-1] in ("t_fault", "t_stop", "f_ack") and time.monotonic() > acknowledged + 3.0:
                acknowledged = time.monotonic()
                self.type("")
            time.sleep(0.1)


@pytest.fixture(scope="module")
def franky(tmp_path_factory) -> Iterator[Cell]:
    url = available(FRANKY)
    command, address = franky_sim()
    folder = tmp_path_factory.mktemp("franky")
    with running(command, folder / "peer.log", lambda: answers(address)):
        yield Cell(url, address, folder)


def limits_kept(out: Path):
    """What the log says of the commands, whatever the bridge says."""
    settings = tuple(f"lcm.{setting}" for setting in PATIENT)
    check = check_commands(read_log(out / "lcm.log"), load_scenario("ikea_chair", settings).lcm)
    assert check.kept, check
    return check


def test_a_whole_assembly_on_franky_sim(franky, tmp_path, capsys):
    with franky.driver(), Bridge(franky, tmp_path / "run") as bridge:
        bridge.wait_for("running", 120.0)
        code = bridge.end(300.0)
        with capsys.disabled():
            print(f"\n{bridge.said}")
    assert code == 0, bridge.said
    summary = json.loads((bridge.out / "summary.json").read_text())
    assert summary["finished"]
    assert summary["commands"]["kept"]
    check = limits_kept(bridge.out)
    assert check.num_commands > 5000
    assert check.start <= 1e-3
    assert 0.0 < check.tracking_rms < 1.0
    assert summary["retraced"]["decisions"] >= 3
    assert summary["retraced"]["equal"] == summary["retraced"]["decisions"]
    done = [row["name"] for row in bridge.rows("reaction") if row["name"] in ("j_done", "h_end")]
    assert done == ["j_done", "j_done", "j_done", "h_end"]
    assert (bridge.out / "timeline.png").read_bytes().startswith(b"\x89PNG")
    replayed = subprocess.run(
        [*PACE, "replay", str(bridge.out)], capture_output=True, text=True, env=environment(), timeout=300.0
    )
    with capsys.disabled():
        print(replayed.stdout)
    assert replayed.returncode == 0, replayed.stderr
    assert "against the" in replayed.stdout


def test_bridge_killed_and_restarted_and_a_second_one_refused(franky, tmp_path):
    with franky.driver(), Bridge(franky, tmp_path / "killed") as bridge:
        bridge.wait_for("running")
        time.sleep(2.0)
        with Bridge(franky, tmp_path / "second") as second:
            assert second.end(60.0) == 2
            assert "the robot is not ready: nobody else commands" in second.said
            assert not second.out.exists()
        assert bridge.process.poll() is None
        bridge.process.send_signal(signal.SIGKILL)
        bridge.end(10.0)
        # What happened is there to the last message, and says that no limit was broken.
        assert limits_kept(bridge.out).num_commands > 100
        assert bridge.rows("episode")[0]["name"] == "start"
        with Bridge(franky, tmp_path / "again") as again:
            again.wait_for("running")
            time.sleep(2.0)
            again.process.send_signal(signal.SIGINT)
            assert again.end(30.0) == 130
            assert "the arm holds; what happened is in" in again.said
            assert limits_kept(again.out).num_commands > 100
            assert again.rows("episode")[-1]["name"] == "interrupted"


def test_driver_killed_and_restarted(franky, tmp_path):
    with Bridge(franky, tmp_path / "run") as bridge:
        with franky.driver() as process:
            bridge.wait_for("running")
            time.sleep(2.0)
            process.kill()
            bridge.wait_for("fault: no PANDA_STATUS for")
        with franky.driver():
            bridge.acknowledge_until("s_reissue", 1)
            task = [row["robot_task"] for row in bridge.rows("command") if row["name"] == "ROBOT_TASK"]
            assert task[0] == task[1]  # the interrupted one is issued again
            bridge.acknowledge_until("r_done", 2)  # the first is that of the beginning
            bridge.process.send_signal(signal.SIGINT)
            assert bridge.end(30.0) == 130
    limits_kept(bridge.out)


def test_reflex_recovery_and_resumption_on_franka_sim(tmp_path, capsys):
    url = available(FRANKY, FRANKA)
    command, address = franka_sim()
    with running(command, tmp_path / "peer.log", lambda: answers(address)):
        cell = Cell(url, address, tmp_path)
        with cell.driver() as process, Bridge(cell, tmp_path / "run") as bridge:
            bridge.wait_for("running")
            time.sleep(2.0)
            # The controller waits 20 ms for commands, and then ends the motion by itself: a reflex.
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.3)
            process.send_signal(signal.SIGCONT)
            bridge.wait_for("fault: robot mode is Reflex")
            log = next(tmp_path.glob("driver-*.log"))
            assert until(lambda: "recovered" in log.read_text(), 30.0), log.read_text()
            before = bridge.reactions()
            assert before[-1] == "t_fault"
            operator = [*PACE, "operator", "ack", "--lcm-url", url]
            subprocess.run(operator, check=True, env=environment(), timeout=30.0)
            assert until(lambda: bridge.reactions()[len(before) :][:1] == ["f_ack"], 10.0), bridge.said
            if not until(lambda: "s_reissue" in bridge.reactions(), 3.0):
                bridge.acknowledge_until("s_reissue", 1)
            task = [row["robot_task"] for row in bridge.rows("command") if row["name"] == "ROBOT_TASK"]
            assert task[0] == task[1]
            bridge.acknowledge_until("r_done", 2)
            bridge.process.send_signal(signal.SIGINT)
            assert bridge.end(30.0) == 130
            with capsys.disabled():
                print(f"\n{bridge.said}")
    limits_kept(bridge.out)


def test_a_real_recording_is_replayed_without_a_fault(shared_data, capsys):
    log = str(shared_data / "panda_status.lcmlog")
    replayed = subprocess.run(
        [*PACE, "replay", log], capture_output=True, text=True, env=dict(os.environ), timeout=120.0
    )
    with capsys.disabled():
        print(f"\n{replayed.stdout}")
    assert replayed.returncode == 0, replayed.stderr
    assert "4262 status messages over 4.3 s, 0 that cannot be used; 0 times trouble" in replayed.stdout
    assert "nothing would have been commanded" in replayed.stdout
