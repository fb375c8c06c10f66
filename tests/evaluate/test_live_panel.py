"""LivePanel: Meshcat's controls say what the diagram's outputs say."""

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams

from pace_drake.diagram import Assembly
from pace_drake.evaluate.live_panel import LivePanel
from pace_drake.policies.factory import make_policy
from pace_drake.scenario import load_scenario
from pace_drake.simulation import Simulation


@pytest.fixture(scope="module")
def meshcat():
    return Meshcat(MeshcatParams(host="localhost"))


@pytest.fixture(scope="module")
def simulation():
    scenario = load_scenario("ikea_chair")
    return Simulation(Assembly(scenario, make_policy("always_assist", scenario)))


def test_the_controls_follow_the_episode(meshcat, simulation):
    panel = LivePanel(meshcat, longest=5.0)
    simulation.reset(simulation.sample_episode(np.random.default_rng(1)))
    shown = []

    def show():
        panel.show(simulation)
        assert meshcat.GetSliderValue("phase") == pytest.approx(min(simulation.output("phase")[0], 1.0), abs=0.0051)
        for name in ("robot_idle", "human_idle", "cost"):
            value = min(simulation.output(name).sum(), 5.0)
            assert meshcat.GetSliderValue(f"{name.replace('_', ' ')} [s]") == pytest.approx(value, abs=0.051)
        (state,) = [state for state in STATES if _has_button(meshcat, state)]
        shown.append(state)

    while simulation.time < 50.0 and shown[-1:] != STATES[-1:]:
        simulation.advance(simulation.time + 1.0)
        show()
    assert simulation.output("robot_idle").sum() > 5.0  # beyond the end of the sliders
    assert list(dict.fromkeys(shown)) == STATES


#: What a robot shows first that always assists: it waits for the rails to be placed.
STATES = [
    "robot: PREP 1, person: place_rails",
    "robot: WAIT 1, person: place_rails",
    "robot: JOINT 1, person: carry_side",
    "robot: HOMING 1, person: place_screws",
]


def _has_button(meshcat, name):
    try:
        meshcat.GetButtonClicks(name)
    except RuntimeError:
        return False
    return True
