"""pace bridge and pace replay: bad input is one line, exit code 2, and leaves nothing; replay shows what happened."""

import json
import signal
import subprocess
import sys
import time

import pytest
from pydrake.lcm import DrakeLcm

from pace_drake.bridge.lcm_log import LcmLog
from pace_drake.bridge.retrace import episode_to_json
from pace_drake.errors import InputError
from tests.bridge.conftest import make_parts
from tests.bridge.rig import Rig
from tests.cli.test_run import pace, refused
from tests.peers.processes import environment, until
from tests.started import started


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A run folder of a bridge to our peer, an arm's work of some seconds with a fault in it."""
    out = tmp_path_factory.mktemp("bridge") / "run"
    out.mkdir()
    rig = Rig(*make_parts())
    rig.work()
    rig.peer.silent = True
    rig.run(0.5)
    rig.peer.silent = False
    rig.run(0.5)
    rig.resume()
    rig.run(1.0)
    (out / "scenario.yaml").write_text(rig.scenario.to_yaml())
    (out / "episode.json").write_text(json.dumps(episode_to_json(rig.episode)))
    times = iter(message.time for message in rig.messages)
    with LcmLog(out / "lcm.log", clock=lambda: next(times)) as log:
        for message in rig.messages:
            log.write(message.channel, message.data)
    return out


def test_replay_shows_what_was_wrong_what_was_decided_and_what_was_commanded(recorded, capsys):
    assert pace("replay", recorded) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "fault: no PANDA_STATUS for 0.0" in shown
    assert "decision: " in shown
    assert "1 times trouble" in shown
    assert "commands, all within the limits" in shown
    assert "against the" in shown
    assert "0.0 mrad in the median" in shown


def test_replay_of_a_log_takes_the_scenario_beside_it(recorded, capsys):
    assert pace("replay", recorded / "lcm.log") == 0
    assert "commands, all within the limits" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (None, "cannot read the log: No such file"),
        (b"time,x\n0,1\n" * 9, "is no LCM log"),
        (b"", "no PANDA_STATUS in it"),
    ],
)
def test_replay_refuses_what_is_no_log(tmp_path, capsys, content, line):
    path = tmp_path / "log"
    if content is not None:
        path.write_bytes(content)
    assert line in refused(capsys, "replay", path)


def test_replay_names_the_channels_of_a_log_without_status(tmp_path, capsys):
    with LcmLog(tmp_path / "log") as log:
        log.write("IIWA_STATUS", b"x")
    assert "no PANDA_STATUS in it, but IIWA_STATUS; set lcm.panda_status_channel" in refused(
        capsys, "replay", tmp_path / "log"
    )


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((), "lcm.url is memq, where no robot is: give --lcm-url"),
        (("--lcm-url", "udp://1.2.3.4:5"), "must begin with memq://, udpm://, tcpq://"),
        (("--lcm-url", "memq://"), "lcm.url is memq"),
        (("--set", "lcm.robot=ur5", "--lcm-url", "memq://"), "lcm.robot: must be fer or fr3, is 'ur5'"),
        (("--set", "lcm.comand_rate=1"), "comand_rate"),
    ],
)
def test_bridge_refuses_bad_input_and_leaves_nothing(tmp_path, capsys, arguments, line):
    out = tmp_path / "run"
    assert line in refused(capsys, "bridge", "--person", "simulated", "--out", out, *arguments)
    assert not out.exists()


def test_bridge_does_not_write_over_a_folder(tmp_path, capsys):
    (tmp_path / "file").touch()
    url = "u" + "dpm://239.255.76.67:7699?ttl=0"  # refused before it is opened
    line = refused(capsys, "bridge", "--person", "simulated", "--out", tmp_path, "--lcm-url", url)
    assert "exists and is not empty" in line


def test_with_a_real_person_what_is_of_synthetic_ones_is_said(tmp_path, monkeypatch, capsys):
    lcm = DrakeLcm("memq://")
    monkeypatch.setattr("pace_drake.lcm.url.open_lcm", lambda config: lcm)

    def connect(session):
        lcm.Publish("PACE_HAND_SYNTHETIC", b"SYNTHETIC people (seed 0)")  # as `pace hand` does
        lcm.HandleSubscriptions(0)

    def end(run, session):
        run._report(session, False)
        assert json.loads((run.out / "summary.json").read_text())["synthetic"] == run.synthetic
        assert json.loads((run.out / "summary.json").read_text())["people"] == "not real: SYNTHETIC people (seed 0)"
        raise InputError("this is the end")

    monkeypatch.setattr("pace_drake.bridge.session.Session.connect", connect)
    monkeypatch.setattr("pace_drake.cli.bridge._WATCHING_TIME", 0.0)
    monkeypatch.setattr("pace_drake.cli.bridge._Run._check", end)
    url = "u" + "dpm://239.255.76.67:7699?ttl=0"  # never opened
    out = ("--out", tmp_path / "run", "--set", "human.monitor=button", "--lcm-url", url)
    assert pace("bridge", *out) == 2
    said = capsys.readouterr()
    assert "this is the end" in said.err
    (line,) = [one for one in said.out.splitlines() if one.startswith("warning: the person is real")]
    assert "of SYNTHETIC people are: references and durations of place_rails, place_screws, tighten_screws" in line
    assert "policy learned" in line
    assert "warning: the hand is not real: SYNTHETIC people (seed 0)" in said.out


@pytest.mark.hardware
@pytest.mark.slow
def test_bridge_without_a_robot_says_so_and_leaves_nothing(tmp_path):
    from tests.network import own_url, why_not

    url = own_url()
    if reason := why_not(url):
        pytest.skip(reason)
    out = tmp_path / "run"
    command = [sys.executable, "-m", "pace_drake.cli.main", "bridge", "--person", "simulated", "--lcm-url", url]
    done = subprocess.run(
        [*command, "--out", str(out)], capture_output=True, text=True, env=environment(), timeout=120.0
    )
    assert done.returncode == 2
    assert done.stderr == (
        "pace: no usable PANDA_STATUS message within 5 s: start the robot's driver, or correct lcm.url or the channel\n"
    )
    assert not out.exists()
    person = [*command, "--person", "lcm", "--out", str(out)]
    done = subprocess.run(person, capture_output=True, text=True, env=environment(), timeout=120.0)
    assert done.returncode == 2
    assert "human.monitor: a real person does not tell the robot what they do" in done.stderr
    assert not out.exists()
    # Ctrl-C while it waits ends it as well.
    with started(
        [*command, "--out", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment()
    ) as process:
        until(out.exists, 60.0)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) in (2, 130)
