"""What a user can get wrong is one line and exit code 2."""

import os
import subprocess
import sys

import pytest

from tests.network import own_url, why_not

ARGUMENTS = {"--robot": "fr3", "--ip": "127.0.99.99", "--lcm-url": "", "--hand": "none"}


def run_driver(**changes: str) -> subprocess.CompletedProcess:
    options = ARGUMENTS | {"--lcm-url": own_url()} | changes
    words = [word for pair in options.items() for word in pair if word]
    environment = {name: value for name, value in os.environ.items() if name != "DRAKE_ALLOW_NETWORK"}
    command = [sys.executable, "-m", "pace_drake.cli.main", "driver", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"--robot": "ur5"}, "--robot: 'ur5' is unknown: choose fer or fr3"),
        ({"--lcm-url": "memq://"}, "memq:// reaches nobody outside this process"),
        ({"--lcm-url": "http://x"}, "must begin with memq://, udpm://, tcpq://"),
        ({"--status-rate": "50"}, "must be from 200 to 1000 Hz"),
        ({"--start-tolerance": "3"}, "driver.start_tolerance: must be at most 0.2 rad, not 3"),
        ({"--recover-delay": "-1"}, "driver.recover_delay: must be positive"),
        ({}, "no robot at 127.0.99.99 (Connection to FCI refused."),
        ({"--robot": "fer"}, "no robot at 127.0.99.99 (Connection to FCI refused."),
        ({"--ip": "nobody.invalid"}, "no robot at nobody.invalid (Connection error: Host not found)"),
    ],
)
def test_bad_input_is_one_line(changes, message):
    if "--lcm-url" not in changes and (reason := why_not(own_url())):
        pytest.skip(reason)
    if not changes or "--ip" in changes or changes.get("--robot") == "fer":
        pytest.importorskip("pylibfranka", reason="needs the extra 'driver'")
        pytest.importorskip("panda_py", reason="needs the extra 'driver'")
    result = run_driver(**changes)
    assert result.returncode == 2, result.stderr
    last = result.stderr.splitlines()[-1]
    assert last.startswith("pace: ")
    assert message in last
    assert "Traceback" not in result.stderr
