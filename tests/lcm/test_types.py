"""The LCM types of this project: what is committed is what lcm-gen makes of the .lcm files."""

import subprocess
import sys
from pathlib import Path

import pytest

from pace_drake.lcm import types
from pace_drake.lcm.types import lcmt_pace_decision, lcmt_pace_hand, lcmt_pace_operator

TYPES = Path(types.__file__).parent


def test_generated_code_is_that_of_the_lcm_files(tmp_path):
    pytest.importorskip("lcm", reason="the optional Python package lcm is not installed")
    generator = Path(sys.executable).with_name("lcm-gen")
    sources = sorted(TYPES.glob("*.lcm"))
    assert len(sources) == 4
    arguments = ["-p", "--python-no-init", "--ppath", str(tmp_path), *map(str, sources)]
    subprocess.run([generator, *arguments], check=True, capture_output=True, timeout=60)
    made = {path.name: path.read_text() for path in (tmp_path / "pace_drake" / "lcm" / "types").iterdir()}
    assert made == {path.name: path.read_text() for path in TYPES.glob("lcmt_*.py")}


def test_types_survive_the_way():
    hand = lcmt_pace_hand()
    hand.utime, hand.sequence, hand.p_WH = 1_700_000_000_000_000, 7, [0.5, -0.25, 1.0]
    decoded = lcmt_pace_hand.decode(hand.encode())
    assert (decoded.utime, decoded.sequence, list(decoded.p_WH)) == (hand.utime, 7, [0.5, -0.25, 1.0])

    operator = lcmt_pace_operator()
    operator.utime, operator.sender, operator.event = 1, "person", lcmt_pace_operator.STOP
    decoded = lcmt_pace_operator.decode(operator.encode())
    assert (decoded.utime, decoded.sender, decoded.event) == (1, "person", 2)

    decision = lcmt_pace_decision()
    decision.assist, decision.leaf, decision.num_observation, decision.observation = -1, "PREP", 3, [4.0, 1.0, 2.5]
    decoded = lcmt_pace_decision.decode(decision.encode())
    assert (decoded.assist, decoded.leaf, list(decoded.observation)) == (-1, "PREP", [4.0, 1.0, 2.5])


def test_types_need_no_lcm_package():
    code = "import pace_drake.lcm.types, sys; print([m for m in ('lcm', 'pydrake', 'drake') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
