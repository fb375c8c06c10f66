"""What the tests of engines need: node, and W3C's and SCION's cases from npm (never part of this repository)."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.statechart.appendix_d import NodeProcess

PACKAGE, VERSION = "@scion-scxml/test-framework", "2.0.16"
FOLDER = Path(__file__).resolve().parents[2] / ".npm"


@pytest.fixture(scope="session")
def node():
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    process = NodeProcess()
    yield process
    process.close()


@pytest.fixture(scope="session")
def cases() -> Path:
    """The folder with the cases, installed once by npm."""
    found = FOLDER / "node_modules" / PACKAGE
    if not found.is_dir() or json.loads((found / "package.json").read_text())["version"] != VERSION:
        if shutil.which("npm") is None:
            pytest.skip(f"npm is not installed, and with it no {PACKAGE}")
        command = ["npm", "install", "--ignore-scripts", "--no-audit", "--no-fund", "--prefix", str(FOLDER)]
        try:
            done = subprocess.run([*command, f"{PACKAGE}@{VERSION}"], capture_output=True, text=True, timeout=120)
        except subprocess.TimeoutExpired:
            pytest.skip(f"npm took more than 120 s to install {PACKAGE}")
        if done.returncode != 0:
            pytest.skip(f"npm cannot install {PACKAGE}: {(done.stderr.strip() or '?').splitlines()[-1]}")
    return found / "test"
