"""The evaluation of perception: what must hold at the working distance, and what is hidden."""

import json

import numpy as np
import pytest

from pace_drake.evaluate.perception import PICTURES, evaluate, random_poses, working_height
from pace_drake.evaluate.perception_report import annotate, tables, to_json
from pace_drake.stations.camera import pinhole_camera
from pace_drake.stations.workcell import Workcell
from tests.cli.test_run import pace
from tests.rendering import require_opencv, require_rendering


@pytest.fixture(scope="module")
def evaluation():
    require_rendering()
    require_opencv()
    return evaluate(Workcell(), num_poses=2, seed=3, done=lambda: None)


def test_at_the_working_distance_all_is_seen_within_millimetres(evaluation):
    measured = [
        m
        for m in evaluation.measurements
        if m.height == working_height(evaluation.workcell, m.camera) and m.pictures != "no depth"
    ]
    assert len(measured) == 2 * 7 * 2
    assert all(m.position_error is not None for m in measured)
    assert np.median([m.position_error for m in measured]) < 2e-3
    assert max(m.position_error for m in measured) < 5e-3
    assert max(m.yaw_error for m in measured) < np.radians(2.0)


def test_errors_are_not_zero_and_grow_without_depth(evaluation):
    def median(pictures):
        return np.median([m.position_error for m in evaluation.measurements if m.pictures == pictures and m.yaw_error])

    assert 1e-6 < median("noisy") < median("no depth")


def test_what_is_hidden_is_not_seen(evaluation):
    whole = [h for h in evaluation.hidden if h.covered == "whole"]
    assert len(whole) == 4
    assert all(h.position_error is None for h in whole)


def test_components_stay_apart_and_in_their_zones():
    rng = np.random.default_rng(0)
    for _ in range(200):
        poses = random_poses(Workcell(), rng)
        cubes = np.array([pose.p_WO for name, pose in poses.items() if name.startswith("cube")])
        distances = np.linalg.norm(cubes[:, None] - cubes[None], axis=2)[np.triu_indices(len(cubes), 1)]
        assert distances.min() > 0.04 * np.sqrt(2)  # no two overlap, however turned
        assert np.all(np.abs(cubes[:, 0] - 0.35) <= 0.2 - 0.02)  # on the table


def test_tables_and_json_say_the_same(evaluation):
    figures = to_json(evaluation)
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
    working, heights, hidden = tables(evaluation)
    assert len(working.rows) == len(figures["working"]) == 7 * len(PICTURES)
    assert len(heights.rows) == 2 * 4 * len(PICTURES)
    assert [row[2] for row in hidden.rows] == [str(row["looks"]) for row in figures["hidden"]]
    first = figures["working"][0]
    assert working.rows[0][0] == first["component"] == "cube_1"
    assert working.rows[0][5] == f"{first['position_mm_median']:.2f}"


def test_found_axes_are_drawn_where_the_component_is(evaluation):
    (view,) = [v for v in evaluation.views if v.camera == "sorting_camera"]
    assert set(view.found) == {"cube_1", "cube_2", "cube_3", "cube_4"}
    camera = pinhole_camera(evaluation.workcell.cameras["sorting_camera"])
    drawn = annotate(view, camera)
    middles = []
    for pose in view.found.values():
        # The middle of the x axis, which is red (blue green red).
        u, v = np.rint(camera.project(pose.to_world(np.array([[0.03, 0.0, 0.0]]))))[0].astype(int)
        middles.append(drawn[v, u].tolist() == [0, 0, 255])
    assert sum(middles) >= 3  # one may lie under a neighbour's label


def test_the_command_writes_what_it_says(tmp_path):
    require_rendering()
    require_opencv()
    figures, out = tmp_path / "figures.json", tmp_path / "out"
    assert pace("evaluate", "perception", "--poses", 1, "--json", figures, "--out", out) == 0
    assert {path.name for path in out.iterdir()} == {"errors.csv", "sorting_camera.png", "warehouse_camera.png"}
    assert json.loads(figures.read_text())["working"][0]["looks"] == 1
    assert len((out / "errors.csv").read_text().splitlines()) == 1 + 7 * 4 * len(PICTURES)
