"""Shared by all tests: no network, one diagram per session (Drake never frees Python systems)."""

import os
from pathlib import Path

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
