"""Tag: its corners on the component."""

import numpy as np

from pace_drake.perception import Tag


def test_corners_go_clockwise_from_the_printed_upper_left():
    corners = Tag(3, (1.0, 2.0, 0.5), 0.2).corners()
    np.testing.assert_allclose(corners, [[0.9, 2.1, 0.5], [1.1, 2.1, 0.5], [1.1, 1.9, 0.5], [0.9, 1.9, 0.5]])


def test_yaw_turns_the_print_about_its_middle():
    corners = Tag(3, (1.0, 2.0, 0.5), 0.2, yaw=np.pi / 2).corners()
    np.testing.assert_allclose(corners[0], [0.9, 1.9, 0.5])  # a quarter turn to the left
