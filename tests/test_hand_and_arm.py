"""Hand and arm in joint actions and right after them: near, but never in the same place."""

import numpy as np
import pytest

from pace_drake.people import load_people
from pace_drake.safety.proximity import approach
from pace_drake.scenario import load_scenario
from pace_drake.stations.arm_capsules import load_arm_capsules
from pace_drake.stations.joint_paths import joint_paths
from pace_drake.stations.motions import plan_motions
from pace_drake.stations.person import LIMB_RADII, limb_segments
from pace_drake.systems.human import Human
from pace_drake.task import ActionKind
from tests.evaluate.test_workcell import SHORT


@pytest.mark.parametrize("joint_action", [1, 2, 3])
def test_hand_and_arm_do_not_overlap_in_a_joint_action_nor_while_the_robot_goes_home(joint_action):
    """The motions as planned, in the fifty short episodes of docs/workcell.md; nothing slows the arm here."""
    scenario = load_scenario("ikea_chair", SHORT)
    task, people, arm = scenario.task, load_people(scenario), load_arm_capsules()
    motions = plan_motions(scenario.workcell, task.num_robot_tasks, task.num_joint_actions)
    human = Human(task, people.demonstrations, joint_paths(scenario.workcell, task.num_joint_actions))
    context, hand = human.CreateDefaultContext(), human.GetOutputPort("p_WH")
    least = {}
    for number in range(50):
        episode = people.sample(scenario, np.random.default_rng([1, number]))
        human.set_episode(context, episode)
        state = context.get_discrete_state_vector().value().copy()
        state[:2] = joint_action, 0.0  # it begins at 0 s
        context.SetDiscreteState(state)
        action = episode.human[task.human_index_of_joint[joint_action - 1] - 1]
        homing = episode.homing[joint_action - 1]
        for kind, begin, duration in ((ActionKind.JOINT, 0.0, action), (ActionKind.HOME, action, homing)):
            motion = motions.motion(kind, joint_action)
            assert motion.duration < duration
            for share in np.linspace(0.0, 0.999, 60):
                context.SetTime(begin + share * duration)
                limbs = limb_segments(hand.Eval(context))
                near = approach(arm, motion.position(share)[None], np.zeros((1, 7)), limbs, LIMB_RADII)
                least[kind] = min(least.get(kind, np.inf), near.distance.min())
    assert least[ActionKind.JOINT] > (0.1 if joint_action == 1 else 0.02)
    assert least[ActionKind.HOME] > 0.03
