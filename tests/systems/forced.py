"""Updating one system by hand, as ``pace_drake.simulation.Simulation`` does at an event."""


def force_update(dut, context):
    """Runs the forced discrete update of ``dut`` on its own context."""
    values = dut.AllocateDiscreteVariables()
    values.SetFrom(context.get_discrete_state())
    dut.CalcForcedDiscreteVariableUpdate(context, values)
    context.SetDiscreteState(values)
