"""PhaseEstimator: streaming in the diagram equals the library's batch; cleared when the action changes."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from pace_drake.dtw import OpenEndSoftDTW
from pace_drake.systems.phase_estimator import PhaseEstimator


@pytest.fixture(scope="module")
def references():
    rng = np.random.default_rng(0)
    return [np.cumsum(rng.normal(size=(n, 3)), axis=0) for n in (60, 45)]


@pytest.fixture(scope="module")
def dut(references):
    first, second = (OpenEndSoftDTW(r, 0.1, window=0.8) for r in references)
    return PhaseEstimator([first, None, second], sample_period=0.1)


def test_streaming_equals_batch_and_a_new_action_starts_afresh(dut, references):
    rng = np.random.default_rng(1)
    simulator = Simulator(dut)
    context = simulator.get_mutable_context()
    simulator.Initialize()
    time = 0.0
    for action in (1, 3, 1):
        dut.GetInputPort("human_action").FixValue(context, float(action))
        reference = references[0 if action == 1 else 1]
        query = reference[:40] + rng.normal(scale=0.3, size=(40, 3))
        assert dut.GetOutputPort("phase").Eval(context)[0] == 0.0  # before the action's first sample
        estimated = []
        for sample in query:
            dut.GetInputPort("p_WH").FixValue(context, sample)
            time += 0.1
            simulator.AdvanceTo(time - 0.05)
            estimated.append(dut.GetOutputPort("phase").Eval(context)[0])
        expected = OpenEndSoftDTW(reference, 0.1, window=0.8).phase(query)
        assert np.array_equal(estimated, expected)
        assert 0 < estimated[-1] < 1


def test_without_a_reference_the_phase_is_one(dut):
    context = dut.CreateDefaultContext()
    dut.GetInputPort("human_action").FixValue(context, 2.0)
    assert dut.GetOutputPort("phase").Eval(context)[0] == 1.0


def test_a_hand_that_is_not_seen_is_no_sample(dut, references):
    def phases(query):
        simulator = Simulator(dut)
        context = simulator.get_mutable_context()
        dut.GetInputPort("human_action").FixValue(context, 1.0)
        for k, sample in enumerate(query):
            dut.GetInputPort("p_WH").FixValue(context, sample)
            simulator.AdvanceTo(0.1 * k + 0.05)
            yield dut.GetOutputPort("phase").Eval(context)[0]

    nowhere, query = np.full((3, 3), np.nan), references[0][:30]
    seen = list(phases(np.concatenate([nowhere, query])))
    assert seen[:3] == [0.0, 0.0, 0.0]
    assert seen[3:] == list(phases(query))


def test_it_is_idle_once_an_action_without_an_estimator_has_cleared_it(dut, references):
    """So an action that comes again after such a one begins afresh."""
    context = dut.CreateDefaultContext()

    def take(action, sample):
        dut.GetInputPort("human_action").FixValue(context, action)
        dut.GetInputPort("p_WH").FixValue(context, sample)
        return dut.take_sample(context)

    for sample in references[0][:30]:
        assert take(1.0, sample)
    assert dut.GetOutputPort("phase").Eval(context)[0] > 0.2
    dut.GetInputPort("human_action").FixValue(context, 2.0)
    assert not dut.idle(context)
    assert not take(2.0, references[0][30])
    assert dut.idle(context)
    dut.GetInputPort("human_action").FixValue(context, 1.0)
    assert not dut.idle(context)
    assert dut.GetOutputPort("phase").Eval(context)[0] == 0.0


def test_a_sample_taken_in_place_is_that_of_an_update(dut, references):
    forced = PhaseEstimator(dut._estimators, sample_period=0.1, periodic=False)
    states = []
    for in_place in (True, False):
        context, values = forced.CreateDefaultContext(), forced.AllocateDiscreteVariables()
        forced.GetInputPort("human_action").FixValue(context, 1.0)
        for sample in references[0][:30]:
            forced.GetInputPort("p_WH").FixValue(context, sample)
            if in_place:
                forced.take_sample(context)
            else:
                values.SetFrom(context.get_discrete_state())
                forced.CalcForcedDiscreteVariableUpdate(context, values)
                context.SetDiscreteState(values)
        states.append(context.get_discrete_state_vector().value().copy())
    assert np.array_equal(*states)
    assert states[0].any()
