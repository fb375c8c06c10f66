"""PinholeCamera: rays and pixels belong together."""

import numpy as np

from tests.perception.synthetic import camera_above


def test_the_middle_pixel_looks_straight_down_and_x_goes_right():
    camera = camera_above(0.3, -0.2, 0.8)
    np.testing.assert_allclose(camera.project(np.array([[0.3, -0.2, 0.0]])), [[479.5, 359.5]])
    right, above = camera.project(np.array([[0.4, -0.2, 0.0], [0.3, -0.1, 0.0]]))
    np.testing.assert_allclose(right, [479.5 + 1100 * 0.1 / 0.8, 359.5])
    assert above[1] < 359.5


def test_points_on_rays_project_back():
    camera = camera_above(0.3, -0.2, 0.8, tilt=0.4)
    pixels = np.random.default_rng(0).uniform([0, 0], [960, 720], (20, 2))
    points = camera.to_world(camera.rays(pixels) * np.linspace(0.3, 2.0, 20)[:, None])
    np.testing.assert_allclose(camera.project(points), pixels, atol=1e-9)
