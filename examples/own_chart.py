"""A statechart of your own in a Drake diagram: ``python examples/own_chart.py``.

``pace chart check examples/door.scxml`` proves what must hold of it, ``pace chart draw`` draws it.
"""

from pathlib import Path

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Integrator, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from pace_drake.statechart import compile_chart, load_chart
from pace_drake.systems.statechart import StatechartSystem


def run() -> tuple[list[str], float]:
    """Returns the transitions taken, in order, and how far the door moved [m]."""
    chart = compile_chart(load_chart(Path(__file__).with_name("door.scxml")))
    builder = DiagramBuilder()
    door = builder.AddSystem(StatechartSystem(chart, reaction_period=0.1))
    person = PiecewisePolynomial.ZeroOrderHold([0.0, 1.0, 2.0, 9.0], np.array([[0.0, 1.0, 0.0, 0.0]]))
    alarm = PiecewisePolynomial.ZeroOrderHold([0.0, 3.0, 6.0, 9.0], np.array([[0.0, 1.0, 0.0, 0.0]]))
    for name, signal in (("person", person), ("alarm", alarm)):
        source = builder.AddSystem(TrajectorySource(signal))
        builder.Connect(source.get_output_port(), door.GetInputPort(name))
    width = builder.AddSystem(Integrator(1))
    builder.Connect(door.GetOutputPort("speed"), width.get_input_port())
    simulator = Simulator(builder.Build())

    taken: list[str] = []
    for step in range(1, 81):
        simulator.AdvanceTo(step * 0.1 + 0.05)
        for reaction in door.reactions(door.GetMyContextFromRoot(simulator.get_context())):
            print(f"{reaction.time:4.1f} s  {reaction.transition:8s} {reaction.source} -> {reaction.target}")
            taken.append(reaction.transition)
    moved = width.get_output_port().Eval(width.GetMyContextFromRoot(simulator.get_context()))[0]
    print(f"the door moved {moved:.2f} m")
    return taken, float(moved)


if __name__ == "__main__":
    run()
