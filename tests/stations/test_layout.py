"""Layout: where components lie is drawn within their zones, the same for the same seed."""

from itertools import product

import numpy as np
import pytest

from pace_drake.stations.components import components
from pace_drake.stations.layout import nominal_layout, sample_layout
from pace_drake.stations.workcell import Workcell
from pace_drake.task import NUM_ROBOT_DRAWS


@pytest.fixture(scope="module")
def workcell():
    return Workcell()


@pytest.fixture(scope="module")
def drawn(workcell):
    return [sample_layout(workcell, np.random.default_rng(seed)) for seed in range(200)]


def test_sizes(workcell, drawn):
    for layout in (nominal_layout(workcell), drawn[0]):
        assert layout.located.shape == (len(components(workcell)), 3)
        assert layout.pile.shape == (NUM_ROBOT_DRAWS, len(workcell.cubes), 3)


def test_the_nominal_layout_is_the_middle_of_every_zone(workcell):
    layout = nominal_layout(workcell)
    for component, located in zip(components(workcell), layout.located, strict=True):
        np.testing.assert_array_equal(located[:2], component.nominal.translation[:2])
        assert component.pose(located).IsNearlyEqualTo(component.nominal.to_rigid_transform(), 1e-12)
    assert np.all(layout.pile == layout.located[: len(workcell.cubes)])


def test_draws_fill_the_zone_and_do_not_leave_it(workcell, drawn):
    spread = np.array([component.spread for component in components(workcell)])
    nominal = nominal_layout(workcell)
    located = np.array([layout.located for layout in drawn]) - nominal.located
    pile = np.concatenate([layout.pile for layout in drawn[:4]]) - nominal.pile[0]
    for off, most in ((located, spread), (pile, spread[: len(workcell.cubes)])):
        assert np.all(np.abs(off) <= most + 1e-12)
        assert np.all(off.max(0) > 0.9 * most)
        assert np.all(off.min(0) < -0.9 * most)
        np.testing.assert_allclose(off.std(0), most / np.sqrt(3), rtol=0.15)  # evenly


def test_every_component_is_drawn_by_itself(workcell, drawn):
    off = np.array([layout.located for layout in drawn]) - nominal_layout(workcell).located
    values = off.reshape(len(drawn), -1)
    correlation = np.corrcoef(values.T) - np.eye(values.shape[1])
    assert np.max(np.abs(correlation)) < 0.35
    assert len(np.unique(drawn[0].pile[:, 0, 0])) == NUM_ROBOT_DRAWS


def test_the_same_seed_gives_the_same_layout(workcell, drawn):
    again = sample_layout(workcell, np.random.default_rng(7))
    np.testing.assert_array_equal(again.located, drawn[7].located)
    np.testing.assert_array_equal(again.pile, drawn[7].pile)
    assert not np.array_equal(again.located, drawn[8].located)


def test_without_spread_it_is_the_nominal_layout():
    still = Workcell(cube_spread=[0.0] * 3, chair_side_spread=[0.0] * 3, allen_key_spread=[0.0] * 3)
    layout = sample_layout(still, np.random.default_rng(0))
    np.testing.assert_array_equal(layout.located, nominal_layout(still).located)
    np.testing.assert_array_equal(layout.pile, nominal_layout(still).pile)


def test_the_chairs_side_stands_on_its_table_wherever_it_lies():
    """The table is 0.40 x 0.60 m about (0.35, 0.55); the feet are those of models/chair_side.sdf."""
    side = components(Workcell())[4]
    for signs in product((-1.0, 1.0), repeat=3):
        X_WO = side.pose(side.located + np.array(signs) * side.spread)
        for foot in product((-0.12, 0.11), (-0.18, 0.18)):
            x, y, _ = X_WO @ np.array([*foot, 0.0])
            assert abs(x - 0.35) < 0.2 - 0.002
            assert abs(y - 0.55) < 0.3 - 0.002
