"""StatechartSystem: any chart as a LeafSystem."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from pace_drake.errors import InputError
from pace_drake.statechart import compile_chart, load_chart
from pace_drake.systems.statechart import StatechartSystem
from tests.statechart.traces import shipped
from tests.systems.forced import force_update

LAMP = """<scxml xmlns="http://www.w3.org/2005/07/scxml" xmlns:pace="urn:pace-drake:statechart" name="lamp">
<datamodel><data id="button" pace:role="input" pace:type="boolean"/>
<data id="length" expr="2" pace:role="parameter"/><data id="t0" pace:type="time"/><data id="n" pace:type="integer"/>
<data id="power" expr="0" pace:role="output"/><data id="uses" expr="n" pace:role="output"/></datamodel>
<state id="OFF"><transition pace:id="on" cond="button == 1" target="ON"><assign location="t0" expr="now"/></transition>
</state>
<state id="ON" initial="BRIGHT" pace:output="power = length * 10">
 <transition pace:id="off" cond="button == 0 &amp;&amp; now &gt;= t0 + length" target="OFF">
  <assign location="n" expr="n + 1"/></transition>
 <state id="BRIGHT"/>
</state>
</scxml>"""


@pytest.fixture
def lamp(tmp_path):
    path = tmp_path / "lamp.scxml"
    path.write_text(LAMP)
    return compile_chart(load_chart(path))


def test_ports_are_those_of_the_chart(lamp):
    dut = StatechartSystem(lamp)
    inputs = [dut.get_input_port(k).get_name() for k in range(dut.num_input_ports())]
    outputs = [dut.get_output_port(k).get_name() for k in range(dut.num_output_ports())]
    assert dut.get_name() == "lamp"
    assert inputs == ["button"]
    assert outputs == ["power", "uses", "mode", "finished", "next_event_time", "trace"]


def test_it_reacts_and_tells_what_it_did(lamp):
    dut = StatechartSystem(lamp, lamp.parameters(length=3.0))
    context = dut.CreateDefaultContext()
    force_update(dut, context)  # the button is not connected: as the chart declares
    assert dut.reactions(context) == []
    dut.GetInputPort("button").FixValue(context, 1.0)
    context.SetTime(1.0)
    force_update(dut, context)
    (reaction,) = dut.reactions(context)
    assert (reaction.transition, reaction.time) == ("on", 1.0)
    assert (reaction.exited, reaction.entered) == (("OFF",), ("ON", "BRIGHT"))
    assert dut.GetOutputPort("power").Eval(context)[0] == 30.0
    assert dut.GetOutputPort("next_event_time").Eval(context)[0] == 4.0
    dut.GetInputPort("button").FixValue(context, 0.0)
    context.SetTime(4.0)
    force_update(dut, context)
    assert dut.fired(context) == ["off"]
    assert dut.GetOutputPort("uses").Eval(context)[0] == 1.0
    assert dut.GetOutputPort("power").Eval(context)[0] == 0.0


def test_parameters_of_a_context_are_its_own(lamp):
    dut = StatechartSystem(lamp)
    context = dut.CreateDefaultContext()
    dut.GetInputPort("button").FixValue(context, 1.0)
    force_update(dut, context)
    assert dut.GetOutputPort("power").Eval(context)[0] == 20.0
    context.get_mutable_numeric_parameter(0).SetAtIndex(0, 5.0)
    assert dut.GetOutputPort("power").Eval(context)[0] == 50.0
    assert dut.GetOutputPort("next_event_time").Eval(context)[0] == 5.0


def test_clones_resets_and_replays_are_exact():
    rng = np.random.default_rng(3)
    dut = StatechartSystem(shipped("human"), shipped("human").parameters(L=5))
    inputs = rng.integers(0, 3, (200, 3)).astype(float)

    def run(context, steps):
        states = []
        for k, row in steps:
            context.SetTime(float(k))
            for name, value in zip(("ready", "arrive", "finish"), row, strict=True):
                dut.GetInputPort(name).FixValue(context, value)
            force_update(dut, context)
            states.append(context.get_discrete_state_vector().CopyToVector())
        return np.array(states)

    steps = list(enumerate(inputs))
    context = dut.CreateDefaultContext()
    first = run(context, steps[:100])
    clone = context.Clone()
    rest = run(context, steps[100:])
    assert np.array_equal(run(clone, steps[100:]), rest)
    dut.SetDefaultContext(context)
    assert np.array_equal(run(context, steps), np.concatenate([first, rest]))
    assert len(np.unique(first[:, 0])) > 1


def test_two_charts_in_one_diagram(lamp):
    """As in any Drake diagram: periodic updates, each reads what the other was before."""
    builder = DiagramBuilder()
    button = builder.AddSystem(ConstantVectorSource([1.0]))
    first = builder.AddSystem(StatechartSystem(lamp, reaction_period=0.1))
    second = StatechartSystem(lamp, reaction_period=0.1)
    second.set_name("second")
    builder.AddSystem(second)
    builder.Connect(button.get_output_port(), first.GetInputPort("button"))
    builder.Connect(first.GetOutputPort("mode"), second.GetInputPort("button"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(0.05)
    context = simulator.get_context()
    assert first.compiled.leaf(first.chart_state(first.GetMyContextFromRoot(context))) == "BRIGHT"
    assert second.compiled.leaf(second.chart_state(second.GetMyContextFromRoot(context))) == "OFF"
    simulator.AdvanceTo(0.15)
    assert second.compiled.leaf(second.chart_state(second.GetMyContextFromRoot(context))) == "BRIGHT"


def test_a_decision_that_is_no_number_is_no_answer():
    dut = StatechartSystem(shipped("pace_task"))
    context = dut.CreateDefaultContext()
    dut.GetInputPort("a").FixValue(context, np.nan)
    force_update(dut, context)
    assert dut.fired(context) == ["t_start", "r_done"]
    assert dut.GetOutputPort("decision_pending").Eval(context)[0] == 1.0


def test_an_output_may_not_have_the_name_of_a_port_of_the_system(tmp_path):
    path = tmp_path / "lamp.scxml"
    path.write_text(LAMP.replace('"uses"', '"mode"'))
    with pytest.raises(InputError, match=r"lamp.scxml: output 'mode' has the name of a port"):
        StatechartSystem(compile_chart(load_chart(path)))


def test_the_compiled_functions_run_in_numba():
    numba = pytest.importorskip("numba")
    compiled = shipped("pace_task")
    react, in_place, outputs = (numba.njit(f) for f in (compiled.react, compiled.react_in_place, compiled.outputs))
    rng = np.random.default_rng(5)
    p, x = compiled.parameters(), compiled.initial_state()
    y, leaves = x.copy(), set()
    for _ in range(300):
        u = rng.integers(0, 3, len(compiled.inputs())).astype(float)
        u[1:3] *= rng.random() < 0.2
        u[compiled.input_index["done"]] = x[compiled.variable_index["cmd"]] - rng.integers(2)
        expected, fired = compiled.react(x, u, p, 1.0)
        assert react(x, u, p, 1.0)[1] == fired == in_place(y, u, p, 1.0)
        assert np.array_equal(y, expected)
        assert outputs(expected, p) == compiled.outputs(expected, p)
        x = expected
        leaves.add(compiled.leaf(x))
    assert len(leaves) >= 5
