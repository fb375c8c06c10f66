"""The wheel: what a run needs travels in it, from wherever it stands in a checkout."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    pytest.importorskip("hatchling", reason="extra 'dev' is not installed")
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(ROOT)],
        check=True,
        capture_output=True,
    )
    (path,) = out.glob("*.whl")
    return path


def test_everything_is_in_the_wheel(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    for folder in ("models", "scenarios", "statecharts"):
        files = [p.relative_to(ROOT) for p in (ROOT / folder).rglob("*") if p.is_file()]
        assert files
        for file in files:
            assert f"pace_drake/{file.as_posix()}" in names
    for file in (ROOT / "pace_drake").rglob("*.py"):
        assert file.relative_to(ROOT).as_posix() in names
    assert {
        "pace_drake/policies/ikea_chair.onnx",
        "pace_drake/policies/ikea_chair.json",
        "pace_drake/py.typed",
        "pace_drake/evaluate/replay.html",
    } <= names
    assert not [name for name in names if name.startswith(("tests/", "docs/", "examples/"))]


def test_an_unpacked_wheel_runs_without_the_checkout(wheel, tmp_path):
    """In a folder of its own, the package from the wheel first on the path."""
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import pace_drake; assert sys.argv[1] in pace_drake.__file__;"
        "from pace_drake.cli.main import main; main(['run', '--level', 'task', '--out', 'out'])"
    )
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    subprocess.run([sys.executable, "-c", code, str(site)], cwd=elsewhere, check=True, capture_output=True)
    assert (elsewhere / "out" / "summary.json").is_file()
