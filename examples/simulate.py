"""Build the diagram, run an episode, plot the phase: the collaboration as a plain Drake diagram.

python examples/simulate.py [picture.png]
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from pace_drake.diagram import Assembly
from pace_drake.errors import InputError
from pace_drake.evaluate.timeline import check_picture
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation, Stop


def run(picture: str) -> float:
    check_picture(Path(picture))
    scenario = load_scenario("ikea_chair")
    simulation = Simulation(Assembly(scenario, make_policy("phase_threshold", scenario)))
    simulation.reset(simulation.sample_episode(np.random.default_rng(1)))
    times, phases = [], []
    while simulation.advance(boundary=simulation.time + 0.2) != Stop.FINISHED:
        times.append(simulation.time)
        phases.append(simulation.output("phase")[0])
    cost = simulation.output("cost")[0]
    print(f"robot idle {simulation.output('robot_idle')} s, human idle {simulation.output('human_idle')} s")
    print(f"cost {cost:.2f} s after {simulation.num_decisions} decisions and {simulation.time:.1f} s")
    plt.plot(times, phases)
    plt.xlabel("time [s]")
    plt.ylabel("estimated phase of the human action")
    plt.title("synthetic people, not recordings")
    plt.savefig(picture)
    return cost


if __name__ == "__main__":
    try:
        run(sys.argv[1] if len(sys.argv) > 1 else "phase.png")
    except InputError as error:
        sys.exit(str(error))
