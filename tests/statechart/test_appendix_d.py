"""The reference interpreter against the cases of SCION and of W3C's implementation report."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests.statechart.appendix_d import EvaluationError, ExpressionDataModel, Interpreter, NodeProcess

#: SCION's cases that are not passed.
SKIPPED_SCION = {
    "error/error": "wants SCION's own fields (line, column) in the data of an error",
    "more-parallel/test10": "wants a self-transition inside a parallel to stay in its region, unlike Appendix D",
    "more-parallel/test10b": "as more-parallel/test10",
}
#: W3C's mandatory automatic cases that are not passed: all of them need <invoke>.
SKIPPED_W3C = {
    f"test{number}"
    for number in (
        191, 192, 207, 215, 216, 220, 223, 224, 225, 226, 228, 229, 232, 233, 234, 235, 236, 239, 240, 241, 243, 244,
        245, 247, 253, 276, 338, 347, 422, 530,
    )
}  # fmt: skip


def passes_scion(path: Path, node: NodeProcess) -> bool:
    script = json.loads(path.with_suffix(".json").read_text())
    dut = Interpreter(path.read_text(), node.datamodel(), path.parent)
    dut.start()
    seen, expected = [dut.atomic()], [set(script["initialConfiguration"])]
    for step in script["events"]:
        dut.advance(step.get("after", 0) / 1000)
        dut.send(step["event"]["name"], step["event"].get("data"))
        seen.append(dut.atomic())
        expected.append(set(step["nextConfiguration"]))
    return seen == expected


def test_scion(cases, node):
    paths = [path for path in sorted(cases.glob("*/*.scxml")) if path.parent.name != "w3c-ecma"]
    failed = {f"{path.parent.name}/{path.stem}" for path in paths if not passes_scion(path, node)}
    assert len(paths) == 127
    assert failed == set(SKIPPED_SCION)
    assert len(paths) - len(failed) >= 115


def mandatory_automatic(cases: Path) -> list[str]:
    """Those whose ``<test>`` in W3C's manifest says conformance="mandatory" and manual="false"."""
    manifest = ET.parse(cases / "w3c-ecma" / "manifest.xml").getroot()
    tests = [t for t in manifest.iter("test") if (t.get("conformance"), t.get("manual")) == ("mandatory", "false")]
    return [Path(start.get("uri", "")).stem for test in tests for start in test.iter("start")]


def passes_w3c(path: Path, node: NodeProcess) -> bool:
    text = path.read_text()
    dut = Interpreter(text, node.datamodel(ET.fromstring(text).get("name", "")), path.parent)
    dut.start()
    dut.advance(100.0)
    return dut.atomic() == {"pass"}


def test_w3c(cases, node):
    names = mandatory_automatic(cases)
    failed = {name for name in names if not passes_w3c(cases / "w3c-ecma" / f"{name}.txml.scxml", node)}
    assert len(names) >= 158
    assert failed == SKIPPED_W3C
    assert len(names) - len(failed) >= 118


@pytest.mark.parametrize(
    "text",
    ["1 + 2 * 3", "-7 % 4", "7 % -4", "n - 1 - 1", "_event.data.u == 3 && !(n == 1)", "n >= 4 || 2 < 1", "-(-n)"],
)
def test_both_data_models_give_the_same(text, node):
    values = []
    for model in (ExpressionDataModel(), node.datamodel()):
        model.declare("n", "4")
        model.set_event({"name": "e", "data": {"u": 3.0}})
        values.append(model.evaluate(text))
    assert values[0] == values[1]
    assert type(values[0]) is bool or values[0] == float(values[1])


def test_without_node_it_says_what_it_cannot_do():
    model = ExpressionDataModel()
    with pytest.raises(EvaluationError):
        model.execute("n = 1")
    with pytest.raises(EvaluationError):
        model.assign("n", "1")
