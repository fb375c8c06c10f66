"""Imports go one way, and light things load light (docs/design.md)."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "pace_drake"
#: Lower layers must not import higher ones.
LAYERS = [
    ["errors", "files", "graphviz", "ports", "processes", "resources"],
    ["dtw", "statechart", "task", "observation", "perception", "safety"],
    ["demos", "lcm"],
    ["driver"],
    ["stations"],
    ["scenario"],
    ["alignments", "policies", "people", "task_chart"],
    ["systems"],
    ["diagram"],
    ["simulation"],
    ["envs", "evaluate"],
    ["learning", "bridge"],
    ["cli"],
]


def level(module: str) -> int:
    return next(k for k, names in enumerate(LAYERS) if module in names)


def imported(path: Path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("pace_drake."):
            yield node.module.split(".")[1]


def test_every_module_has_its_layer_and_imports_only_lower_ones():
    wrong = []
    for path in PACKAGE.rglob("*.py"):
        module = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        if module == "__init__":
            continue
        wrong += [
            f"{path.relative_to(PACKAGE)} imports {other}" for other in imported(path) if level(other) > level(module)
        ]
    assert not wrong


@pytest.mark.parametrize(
    ("module", "absent"),
    [
        ("pace_drake.safety.separation", ("pydrake", "torch", "matplotlib")),
        ("pace_drake.safety.proximity", ("pydrake", "torch", "matplotlib")),
        ("pace_drake.dtw", ("pydrake", "torch", "matplotlib")),
        ("pace_drake.statechart", ("pydrake", "torch", "matplotlib", "numba")),
        ("pace_drake.perception", ("pydrake", "torch", "matplotlib", "cv2")),
        ("pace_drake.task", ("pydrake", "torch", "matplotlib")),
        ("pace_drake.demos", ("pydrake", "torch", "matplotlib")),
        ("pace_drake.diagram", ("torch", "matplotlib", "onnxruntime", "cv2")),
        ("pace_drake.cli.main", ("pydrake", "torch", "numba", "matplotlib")),
    ],
)
def test_what_is_not_needed_is_not_imported(module, absent):
    code = f"import {module}, sys; print([m for m in {absent} if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


def test_no_file_is_called_utils():
    assert not [p for p in PACKAGE.rglob("*.py") if p.stem in ("utils", "helpers", "misc", "common")]
