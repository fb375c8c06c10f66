import ast
import re
import sys
import types
import warnings
from pathlib import Path

import pytest
from pydrake.lcm import DrakeLcm

from pace_drake.errors import InputError
from pace_drake.lcm import url as dut
from pace_drake.lcm.config import LcmConfig
from tests.network import own_url

UDPM = "udpm://239.255.76.67:7699?ttl=0"  # never opened: every test below puts a stand-in or a refusal before it


def stand_in(monkeypatch: pytest.MonkeyPatch, *, usable: bool) -> list[str]:
    """Puts a stand-in for the package lcm in place; returns the list of URLs that it is asked to open."""
    opened: list[str] = []

    def open_url(url: str) -> object:
        opened.append(url)
        if not usable:
            raise RuntimeError("Couldn't create LCM")
        return object()

    module = types.ModuleType("lcm")
    module.LCM = open_url  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "lcm", module)
    return opened


@pytest.mark.parametrize("url", ["", "PANDA", "udp://239.255.76.67:7667", "file:///tmp/log"])
def test_unknown_scheme_is_refused(url: str) -> None:
    with pytest.raises(InputError, match="must begin with memq://, udpm://, tcpq://"):
        dut.preflight(url)


def test_memq_needs_no_preflight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lcm", None)
    lcm = dut.open_lcm(LcmConfig(url="memq://"))
    received: list[bytes] = []
    lcm.Subscribe("A", received.append)
    lcm.Publish("A", b"1")
    lcm.HandleSubscriptions(0)
    assert received == [b"1"]


def test_lcm_is_off_by_default() -> None:
    assert isinstance(dut.open_lcm(LcmConfig()), DrakeLcm)
    assert LcmConfig().url == "memq://null"


def test_absent_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lcm", None)
    with pytest.raises(InputError, match="pip install 'lcm"):
        dut.open_lcm(LcmConfig(url=UDPM))


def test_folder_named_lcm_is_no_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lcm", types.ModuleType("lcm"))
    with pytest.raises(InputError, match="pip install 'lcm"):
        dut.open_lcm(LcmConfig(url=UDPM))


def test_unusable_url_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    opened = stand_in(monkeypatch, usable=False)
    with pytest.raises(InputError, match="cannot be opened") as raised:
        dut.open_lcm(LcmConfig(url=UDPM))
    assert opened == [UDPM]
    assert "\n" not in str(raised.value)


def test_unusable_url_is_refused_by_the_real_package() -> None:
    pytest.importorskip("lcm", reason="the optional Python package lcm is not installed")
    # 999 is no IPv4 number: refused before any socket is opened. DrakeLcm alone would fall back to memq://.
    with pytest.raises(InputError, match="cannot be opened"):
        dut.open_lcm(LcmConfig(url="udpm://999.0.0.1:7667?ttl=0"))


def test_url_forbidden_by_drake_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch, usable=True)
    monkeypatch.setenv("DRAKE_ALLOW_NETWORK", "meshcat")
    with pytest.raises(InputError, match="DRAKE_ALLOW_NETWORK"):
        dut.open_lcm(LcmConfig(url=UDPM))


@pytest.mark.parametrize("url", ["udpm://239.255.76.67:7699", "udpm://239.255.76.67:7699?ttl=1"])
def test_udpm_that_leaves_the_machine_warns(monkeypatch: pytest.MonkeyPatch, url: str) -> None:
    opened = stand_in(monkeypatch, usable=True)
    with pytest.warns(UserWarning, match="has no ttl=0"):
        dut.preflight(url)
    assert opened == [url]


def test_udpm_on_this_machine_does_not_warn(monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(monkeypatch, usable=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        dut.preflight(UDPM)


def network_lcm(source: str) -> list[int]:
    """Returns the lines of Python source that name a network LCM URL, or leave the URL to LCM's default."""
    lines = []
    for node in ast.walk(ast.parse(source)):
        names_url = (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith(("udpm:", "tcpq:"))
        )
        leaves_default = (
            isinstance(node, ast.Call)
            and getattr(node.func, "id", getattr(node.func, "attr", "")) in ("DrakeLcm", "DrakeLcmParams", "LCM")
            and not (node.args or node.keywords)
        )
        if names_url or leaves_default:
            lines.append(node.lineno)
    return lines


@pytest.mark.parametrize("source", ["DrakeLcm()", "x.DrakeLcm()", f"\nf({UDPM!r})", "lcm.LCM()"])
def test_scan_finds_network_lcm(source: str) -> None:
    assert network_lcm(source) == [source.count("\n") + 1]


def test_no_test_uses_network_lcm() -> None:
    tests = Path(__file__).parents[1]
    # Tests that need a network get their URL from tests/network.py, the next test's subject.
    allowed = {Path(__file__), tests / "network.py"}
    files = [path for path in tests.rglob("*.py") if path not in allowed]
    assert tests / "conftest.py" in files
    assert {str(path): lines for path in files if (lines := network_lcm(path.read_text()))} == {}


def test_the_url_for_tests_stays_on_this_machine() -> None:
    assert re.fullmatch(r"udpm://239\.255\.76\.67:\d+\?ttl=0", own_url())
    assert len(network_lcm((Path(__file__).parents[1] / "network.py").read_text())) == 1
