"""The hand in joint actions: where the person carries the chair's side and takes keys."""

from dataclasses import replace

import numpy as np
import pytest

from pace_drake.stations.joint_paths import CARRY_BEGIN, CARRY_END, KEPT, OFFERED, TAKEN, joint_paths
from pace_drake.stations.workcell import Workcell


def test_shares_of_the_time_increase():
    assert 0 < CARRY_BEGIN < CARRY_END < 1
    assert 0 < OFFERED <= TAKEN < KEPT < 1  # a key is held out before the hand is there


def test_the_first_carries_the_far_end_of_the_chair_s_side_to_its_place():
    workcell = Workcell()
    ((begin, taken), (end, placed)) = joint_paths(workcell, 1)[0]
    assert (begin, end) == (CARRY_BEGIN, CARRY_END)
    X_WO = [pose.to_rigid_transform() for pose in (workcell.chair_side_prepared, workcell.chair_side_placed)]
    # The hand keeps its place on the side, at the person's end of it.
    p_O_hand = [X.inverse() @ p_WH for X, p_WH in zip(X_WO, (taken, placed), strict=True)]
    np.testing.assert_allclose(p_O_hand[0], p_O_hand[1], atol=1e-12)
    assert p_O_hand[0][0] > 0.1


def test_the_others_take_keys_where_they_are_held_out_cyclically():
    workcell = Workcell()
    paths = joint_paths(workcell, 4)
    assert len(paths) == 4
    for path, presentation in zip(paths[1:], (0, 1, 0), strict=True):
        assert [share for share, _ in path] == [TAKEN, KEPT]
        for _, p_WH in path:
            np.testing.assert_array_equal(p_WH, workcell.presentations[presentation].hand)


def test_they_are_the_workcell_s():
    moved = Workcell()
    moved.chair_side_placed.translation[2] += 0.1
    moved = replace(moved, presentations=moved.presentations[:1])
    assert joint_paths(moved, 1)[0][1][1][2] == pytest.approx(joint_paths(Workcell(), 1)[0][1][1][2] + 0.1)
    np.testing.assert_array_equal(joint_paths(moved, 3)[2][0][1], moved.presentations[0].hand)
    assert joint_paths(moved, 0) == []
