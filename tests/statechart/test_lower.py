"""pace_drake.statechart.lower: other engines do the same as the compiled chart, reaction by reaction."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pace_drake.resources import resource_path
from pace_drake.statechart import CompiledChart, compile_chart, load_chart
from pace_drake.statechart.lower import EVENT, to_scxml, to_sismic
from tests.statechart.appendix_d import DataModel, ExpressionDataModel, Interpreter
from tests.statechart.traces import NUM_REACTIONS, NUM_TRACES, Trace, agrees, coverage, shipped, traces

PLAIN = sorted(path.stem for path in resource_path("statecharts").glob("*.scxml"))


@pytest.mark.parametrize("name", PLAIN)
def test_the_plain_charts_are_fresh(name):
    path = resource_path(f"statecharts/plain/{name}.scxml")
    assert path.read_text() == to_scxml(shipped(name)), f"run: pace chart lower {name} -o {Path('statecharts/plain')}"


def test_the_traces_take_every_transition():
    assert (len(traces()), {len(trace.fired) for trace in traces()}) == (NUM_TRACES, {NUM_REACTIONS})
    assert coverage() == {transition.id for transition in shipped("pace_task").chart.transitions}


def test_the_traces_can_be_replayed():
    assert all(agrees(shipped("pace_task"), trace) for trace in traces())


class Sismic:
    """sismic, from PyPI, through the exported YAML."""

    def __init__(self, compiled: CompiledChart, parameters: dict[str, float], _request: pytest.FixtureRequest) -> None:
        reason = "sismic is not installed: pip install sismic"
        io = pytest.importorskip("sismic.io", reason=reason)
        self._event = pytest.importorskip("sismic.model", reason=reason).Event
        interpreter = pytest.importorskip("sismic.interpreter", reason=reason).Interpreter
        self._dut = interpreter(io.import_from_yaml(to_sismic(compiled, parameters)))
        self._dut.execute()

    def react(self, data: dict[str, float]) -> None:
        self._dut.queue(self._event(EVENT, **data))
        self._dut.execute_once()

    def active(self) -> set[str]:
        return set(self._dut.configuration) - {"ROOT"}

    def value(self, name: str) -> float:
        return self._dut.context[name]


class AppendixD:
    """The reference interpreter with its own numbers."""

    def __init__(self, compiled: CompiledChart, parameters: dict[str, float], request: pytest.FixtureRequest) -> None:
        self._dut = Interpreter(to_scxml(compiled, parameters), self._datamodel(request))
        self._dut.start()

    def _datamodel(self, _request: pytest.FixtureRequest) -> DataModel:
        return ExpressionDataModel()

    def react(self, data: dict[str, float]) -> None:
        self._dut.send(EVENT, data)

    def active(self) -> set[str]:
        return self._dut.configuration()

    def value(self, name: str) -> float:
        return self._dut.datamodel.evaluate(name)


class AppendixDOnNode(AppendixD):
    """The reference interpreter with ECMAScript."""

    def _datamodel(self, request: pytest.FixtureRequest) -> DataModel:
        return request.getfixturevalue("node").datamodel()


class QtScxml:
    """Qt's state machines, through PySide6; see qt_engine.py."""

    def __init__(self, compiled: CompiledChart, parameters: dict[str, float], request: pytest.FixtureRequest) -> None:
        if importlib.util.find_spec("PySide6") is None:
            pytest.skip("PySide6 is not installed: pip install 'pace_drake[qt]'")
        command = [sys.executable, "-m", "tests.statechart.qt_engine"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        request.addfinalizer(self._close)
        self._write({"scxml": to_scxml(compiled, parameters), "names": list(compiled.chart.variables)})

    def _close(self) -> None:
        self._process.communicate(timeout=10)

    def _write(self, message: dict) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(message) + "\n")
        self._process.stdin.flush()

    def react(self, data: dict[str, float]) -> None:
        assert self._process.stdout is not None
        self._write(data)
        self._answer = json.loads(self._process.stdout.readline())

    def active(self) -> set[str]:
        return set(self._answer["active"])

    def value(self, name: str) -> float:
        return self._answer["values"][name]


ENGINES = [Sismic, AppendixD, AppendixDOnNode, QtScxml]


def assert_same(compiled: CompiledChart, trace: Trace, engine: type, request: pytest.FixtureRequest) -> None:
    chart = compiled.chart
    dut = engine(compiled, trace.parameters, request)
    for u, time, state in zip(trace.inputs, trace.times, trace.states, strict=True):
        dut.react({**u, chart.time: time})
        assert dut.active() == set(chart.ancestors(compiled.leaf(state)))
        expected = {name: state[place] for name, place in compiled.variable_index.items()}
        assert {name: dut.value(name) for name in expected} == expected


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("part", range(8))
def test_an_engine_does_the_same(engine, part, request):
    for trace in traces()[part::8]:
        assert_same(shipped("pace_task"), trace, engine, request)


CORNERS = """<scxml xmlns="http://www.w3.org/2005/07/scxml" xmlns:pace="urn:pace-drake:statechart"
 name="corners" initial="D">
<datamodel><data id="u" pace:role="input"/><data id="n" expr="-1"/></datamodel>
<state id="A" initial="B"><history id="H" type="deep"><transition target="C"/></history>
 <transition pace:preemptive="true" cond="u == 9" target="D"/>
 <transition cond="u == 1 || u == 2"><assign location="n" expr="n * -3 - (2 - n)"/></transition>
 <transition pace:id="again" cond="u == 8" target="A"/>
 <state id="B"><transition cond="u == 1 || u == 9" target="C"/></state>
 <state id="C" initial="E"><transition cond="!(u != 3)" target="B"/>
  <transition pace:preemptive="true" cond="u &gt;= 9" target="B"/>
  <state id="E"><transition cond="u == 4" target="F"/></state>
  <state id="F"><transition cond="u == 7" target="C"/></state>
 </state>
</state>
<state id="D"><transition cond="u == 5" target="H"/><transition cond="u == 6" target="A"/></state>
</scxml>"""


@pytest.fixture
def corners(tmp_path):
    path = tmp_path / "corners.scxml"
    path.write_text(CORNERS)
    return compile_chart(load_chart(path))


def play(compiled: CompiledChart, inputs: list[dict[str, float]]) -> Trace:
    x = compiled.initial_state().tolist()
    trace = Trace({}, inputs, [0.0] * len(inputs), [], [])
    for u in inputs:
        x, fired = compiled.react(x, compiled.inputs(**u).tolist(), [], 0.0)
        trace.fired.append(fired)
        trace.states.append(x)
    return trace


def test_corners_of_the_semantics(corners):
    """A history before and after it was left, inner before outer, preemption, internal and self-transitions."""
    trace = play(corners, [{"u": u} for u in (5, 4, 9, 5, 7, 1, 3, 1, 2, 4, 8, 9, 6, 9, 5, 1, 4, 10)])
    n = corners.variable_index["n"]
    assert [(corners.leaf(x), x[n]) for x in trace.states] == [
        ("E", -1), ("F", -1), ("D", -1), ("F", -1), ("E", -1), ("E", 0), ("B", 0), ("E", 0), ("E", -2), ("F", -2),
        ("B", -2), ("D", -2), ("B", -2), ("D", -2), ("B", -2), ("E", -2), ("F", -2), ("B", -2),
    ]  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
def test_an_engine_does_the_same_in_the_corners(corners, engine, request):
    rng = np.random.default_rng(1)
    assert_same(corners, play(corners, [{"u": float(u)} for u in rng.integers(1, 11, 400)]), engine, request)
