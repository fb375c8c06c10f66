import pytest

from pace_drake.people import load_people
from pace_drake.scenario import load_scenario
from pace_drake.stations.motions import plan_motions
from tests.bridge.rig import Rig

#: Human actions that take a few seconds. The robot's motions already are as short as its path allows.
SHORT = tuple(
    setting
    for action, mean in ((0, 6), (2, 6), (4, 8))
    for setting in (
        f"task.human_actions.{action}.duration.mean={mean}",
        f"task.human_actions.{action}.duration.minimum=2",
    )
)


def make_parts():
    """A scenario with short human actions, its people and its motions."""
    scenario = load_scenario("ikea_chair", SHORT)
    task = scenario.task
    motions = plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions)
    return scenario, load_people(scenario), motions


@pytest.fixture(scope="session")
def parts():
    """See ``make_parts``."""
    return make_parts()


@pytest.fixture
def rig(parts):
    return Rig(*parts)
