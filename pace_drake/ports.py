"""Declaring the small vector ports that most systems of this package are made of."""

from collections.abc import Callable
from typing import Any

from pydrake.systems.framework import BasicVector, Context, InputPort, LeafSystem, OutputPort


def declare_input(system: LeafSystem, name: str, size: int = 1) -> InputPort:
    """Declares a vector input port."""
    return system.DeclareVectorInputPort(name, BasicVector(size))


def declare_output(
    system: LeafSystem, name: str, calc: Callable[[Context], Any], depends_on: set, size: int | None = None
) -> OutputPort:
    """Declares a vector output port computed by ``calc(context) -> value or sequence``.

    Args:
        system: the system that gets the port.
        name: the port's name.
        calc: pure function of the context.
        depends_on: dependency tickets; Drake recomputes only when one of them changed.
        size: number of elements of a vector; None for a scalar.
    """

    def calc_scalar(context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, calc(context))

    def calc_vector(context: Context, output: BasicVector) -> None:
        output.SetFromVector(calc(context))

    calculate = calc_scalar if size is None else calc_vector
    return system.DeclareVectorOutputPort(name, BasicVector(size or 1), calculate, prerequisites_of_calc=depends_on)


def declare_update(system: LeafSystem, update: Callable, reaction_period: float | None) -> None:
    """Declares when a system of the collaboration's logic updates.

    Args:
        system: a system with discrete state.
        update: ``update(context, discrete_values)``.
        reaction_period: None: only when forced, which ``pace_drake.simulation.Simulation`` does at every event, at its
            exact time; otherwise periodically [s], as on hardware.
    """
    if reaction_period is None:
        system.DeclareForcedDiscreteUpdateEvent(update)
    else:
        system.DeclarePeriodicDiscreteUpdateEvent(reaction_period, 0.0, update)
