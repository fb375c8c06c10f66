"""ComponentDetector on drawn pictures: accuracy, several tags, depth or none, what must not be believed."""

import numpy as np
import pytest

from pace_drake.perception import ComponentDetector, Tag
from tests.perception.synthetic import camera_above, picture, pose
from tests.rendering import require_opencv

require_opencv()

TAGS = {
    "cube": (Tag(0, (0.0, 0.0, 0.02), 0.03),),
    "other": (Tag(1, (0.0, 0.0, 0.02), 0.03),),
    "frame": tuple(Tag(8 + k, (x, y, 0.02), 0.028) for k, (x, y) in enumerate([(0.1, 0.1), (0.1, -0.1), (-0.1, 0.1)])),
}


@pytest.fixture(scope="module")
def dut():
    return ComponentDetector(TAGS)


def errors(found, truth):
    """Distance [m] and turn [rad]."""
    turn = found.yaw - truth.yaw
    return np.linalg.norm(found.p_WO - truth.p_WO), abs(np.arctan2(np.sin(turn), np.cos(turn)))


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_positions_within_a_millimetre_and_yaw_within_a_degree(dut, tilt):
    rng = np.random.default_rng(0)
    for _ in range(8):
        truth = {
            "cube": pose(rng.uniform(-0.25, -0.15), rng.uniform(-0.1, 0.1), 0.02, rng.uniform(-np.pi, np.pi)),
            "frame": pose(rng.uniform(0.05, 0.12), rng.uniform(-0.05, 0.05), 0.02, rng.uniform(-np.pi, np.pi)),
        }
        camera = camera_above(0.0, -0.8 * np.tan(tilt), 0.8, tilt)
        found = dut.detect(*picture(camera, TAGS, truth), camera)
        assert set(found) == {"cube", "frame"}
        for name, expected in truth.items():
            distance, turn = errors(found[name], expected)
            assert distance < 1e-3
            assert turn < np.radians(1.0)


def test_depth_says_how_far_away(dut):
    """A tag of the wrong size, as on a label printed too large, is still found where it is."""
    camera, truth = camera_above(), {"cube": pose(0.1, 0.05, 0.02, 0.4)}
    larger = {"cube": (Tag(0, (0.0, 0.0, 0.02), 0.033),)}
    color, depth = picture(camera, larger, truth)
    assert errors(dut.detect(color, depth, camera)["cube"], truth["cube"])[0] < 1e-3
    assert errors(dut.detect(color, None, camera)["cube"], truth["cube"])[0] > 0.05


@pytest.mark.parametrize("missing", [0.0, np.inf, np.nan])
def test_without_depth_the_tag_itself_says_it_less_well(dut, missing):
    camera, truth = camera_above(), {"cube": pose(0.12, 0.05, 0.02, 0.4)}
    color, depth = picture(camera, TAGS, truth)
    for none in (None, np.full_like(depth, missing)):
        distance, turn = errors(dut.detect(color, none, camera)["cube"], truth["cube"])
        assert distance < 0.01
        assert turn < np.radians(2.0)


def test_of_the_two_poses_that_a_square_allows_the_upright_one_holds(dut):
    """Small, noisy pictures seen at an angle: the flipped pose fits as well, and would be 2 times the angle off."""
    rng = np.random.default_rng(5)
    camera = camera_above(0.0, -0.9 * np.tan(0.35), 0.9, 0.35)
    truth = {"cube": pose(0.02, 0.0, 0.02, 0.8)}
    color, _ = picture(camera, TAGS, truth)
    quads = [quad for _, quad in dut.find_tags(color)]
    for _ in range(50):
        (corners,) = (quad + rng.normal(0.0, 0.4, quad.shape) for quad in quads)
        p_C = dut._corners_by_ippe(TAGS["cube"][0], corners, camera)
        p_W = camera.to_world(p_C)
        normal = np.cross(p_W[1] - p_W[0], p_W[0] - p_W[3])
        assert abs(normal[2]) / np.linalg.norm(normal) > np.cos(0.45)


def test_one_tag_of_several_is_enough(dut):
    camera, truth = camera_above(), {"frame": pose(0.05, 0.0, 0.02, 0.3)}
    color, depth = picture(camera, {"frame": TAGS["frame"][2:]}, truth)
    distance, turn = errors(dut.detect(color, depth, camera)["frame"], truth["frame"])
    assert distance < 4e-3  # half a degree of a single tag at an arm of 0.14 m
    assert turn < np.radians(1.5)


def test_a_hidden_tag_is_not_seen_and_the_others_are(dut):
    camera, truth = camera_above(), {"cube": pose(-0.1, 0.0, 0.02, 0.4), "other": pose(0.1, 0.0, 0.02, 0.0)}
    color, depth = picture(camera, TAGS, truth)
    assert set(dut.detect(color, depth, camera)) == {"cube", "other"}
    u, v = camera.project(truth["cube"].p_WO[None])[0].astype(int)
    color[v - 5 : v + 60, u - 60 : u + 60] = 90  # half of it
    assert set(dut.detect(color, depth, camera)) == {"other"}


def test_an_empty_picture_shows_nothing(dut):
    camera = camera_above()
    assert dut.detect(np.full((720, 960, 3), 128, dtype=np.uint8), None, camera) == {}


def test_what_is_tilted_is_not_used(dut):
    camera, truth = camera_above(), {"cube": pose(0.0, 0.0, 0.02, 0.4)}
    for roll, seen in ((0.1, True), (0.4, False)):
        color, depth = picture(camera, TAGS, truth, roll=roll)
        assert len(dut.find_tags(color)) == 1
        assert ("cube" in dut.detect(color, depth, camera)) == seen


def test_tags_that_contradict_each_other_are_not_believed(dut):
    camera, truth = camera_above(), {"frame": pose(0.0, 0.0, 0.02, 0.3)}
    moved = (*TAGS["frame"][:2], Tag(10, (-0.06, 0.06, 0.02), 0.028))  # 57 mm from where it should be
    assert "frame" not in dut.detect(*picture(camera, {"frame": moved}, truth), camera)


def test_alpha_does_not_matter(dut):
    camera, truth = camera_above(), {"cube": pose(0.1, 0.05, 0.02, 0.4)}
    color, depth = picture(camera, TAGS, truth)
    rgba = np.dstack([color, np.zeros(color.shape[:2], dtype=np.uint8)])
    np.testing.assert_equal(dut.detect(rgba, depth, camera)["cube"].p_WO, dut.detect(color, depth, camera)["cube"].p_WO)


def test_ids_must_differ():
    with pytest.raises(ValueError, match="id of its own"):
        ComponentDetector({"a": (Tag(0, (0, 0, 0), 0.03),), "b": (Tag(0, (0, 0, 0), 0.03),)})
