"""Where the person's hand goes in a joint action."""

import numpy as np

from pace_drake.stations.components import presentation_index
from pace_drake.stations.workcell import Workcell

#: Of a joint action's time: from when to when robot and person carry the chair's side.
CARRY_BEGIN, CARRY_END = 0.35, 0.8
#: From when on the robot holds a key out, and from when to when the hand is there to take it.
OFFERED, TAKEN, KEPT = 0.4, 0.5, 0.6
_P_O_HAND = np.array([0.16, 0.12, 0.0125])  # [m] where the person holds the far end of the chair's side, in its frame


def joint_paths(workcell: Workcell, num_joint_actions: int) -> list[list[tuple[float, np.ndarray]]]:
    """For each joint action, (share of its time, (3) p_WH [m]).

    In the first the person takes the far end of the chair's side and puts it down together with the robot; in the
    others the hand takes a key where it is held out.
    """
    prepared, placed = (
        X_WO.to_rigid_transform() @ _P_O_HAND for X_WO in (workcell.chair_side_prepared, workcell.chair_side_placed)
    )
    paths = []
    for joint_action in range(1, num_joint_actions + 1):
        if joint_action == 1:
            paths.append([(CARRY_BEGIN, prepared), (CARRY_END, placed)])
        else:
            hand = np.array(workcell.presentations[presentation_index(workcell, joint_action)].hand)
            paths.append([(TAKEN, hand), (KEPT, hand)])
    return paths
