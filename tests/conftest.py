"""Shared by all tests: no network, one diagram per session (Drake never frees Python systems)."""

import os
import signal
from pathlib import Path

# Ctrl-C is tried on processes of their own, which inherit that it is ignored where a shell has started us with "&".
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Before any Drake import: LCM over the network is refused; memq:// and Meshcat on localhost are not. Parser needs
# package_map to be allowed, though nothing of ours is downloaded by it.
os.environ["DRAKE_ALLOW_NETWORK"] = "meshcat:package_map"

import pytest

from pace_drake.processes import use_one_thread

use_one_thread()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The recordings beside the repository; never needed by the product."""
    path = Path(__file__).resolve().parents[2] / "shared" / "data"
    if not path.is_dir():
        pytest.skip("../shared/data is not here: it holds recordings used in development only")
    return path


@pytest.fixture(scope="session")
def chair():
    """The default scenario; not to be changed by a test."""
    from pace_drake.scenario import load_scenario

    return load_scenario("ikea_chair")


@pytest.fixture(scope="session")
def chair_people(chair):
    from pace_drake.people import load_people

    return load_people(chair)
