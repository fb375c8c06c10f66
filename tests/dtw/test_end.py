import math

import numpy as np
import pytest

from pace_drake.demos import synthetic_signals
from pace_drake.dtw.end import EndDetector
from pace_drake.dtw.filter import Calibration, PhaseFilter
from pace_drake.dtw.open_end import OpenEndSoftDTW
from pace_drake.errors import InputError
from tests.dtw.test_filter import Given

SURE = Calibration(math.log(10.0), 0.1, (0.0,), (0.0,), (0.05,))


def path(end, num_after=100):
    """Straight to 1 m in 10 s, then at rest at `end` [m]."""
    way = np.minimum(np.arange(100 + num_after) / 100, 1.0)
    return np.column_stack([way, np.where(way < 1.0, way, end)])


def test_a_rest_at_the_goal_ends_the_action_at_once_and_elsewhere_late():
    dut = EndDetector(PhaseFilter(Given(num_axes=2), SURE), (1.0, 1.0))
    at_goal, elsewhere = dut.end(path(1.0)), dut.end(path(0.5))
    assert 100 <= at_goal <= 110
    assert elsewhere > at_goal + 3
    assert dut.end(path(1.0)[:90]) is None


def test_without_a_goal_only_time_ends_it():
    dut = EndDetector(PhaseFilter(Given(num_axes=2), SURE), certain=0.5)
    assert abs(dut.end(path(1.0)) - 102) <= 5


def test_a_rest_on_the_way_through_the_goal_does_not_end_it():
    early = np.vstack([np.column_stack([np.full(30, 0.1), np.full(30, 1.0)]), path(1.0)])
    assert EndDetector(PhaseFilter(Given(num_axes=2), SURE), (1.0, 1.0)).end(early[:60]) is None


def test_it_stays_said():
    dut = EndDetector(PhaseFilter(Given(num_axes=2), SURE), (1.0, 1.0))
    state = dut.initial_state()
    for sample in np.vstack([path(1.0), path(1.0)]):
        dut.step(state, sample)
    assert dut.ended_at(state)


def test_held_out_people():
    """SYNTHETIC people that the detector never saw: the delay and the false ends that docs/estimator.md reports."""
    (action,) = (one for one in synthetic_signals().actions if one.action == "place_screws")
    reference, others = action.train[-1], action.train[:-1]
    estimator = OpenEndSoftDTW(reference.values, 0.68, "wp", 0.8)
    dut = EndDetector(
        PhaseFilter.fit(estimator, [s.values for s in others], (len(reference.values) - 1) * 0.1, 5),
        np.mean([s.values[-1] for s in action.train], axis=0),
    )
    rng = np.random.default_rng(0)
    delays = []
    for signal in action.heldout_people:
        rest = signal.values[-1] + rng.normal(0.0, 0.0015, (80, 3))
        delays.append((dut.end(np.vstack([signal.values, rest])) - len(signal.values) + 1) * 0.1)
    assert 0.3 <= np.median(delays) <= 1.0
    assert np.mean(np.array(delays) < -0.5) <= 0.1


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"goal": (1.0,)}, "goal"),
        ({"goal": (math.nan, 1.0)}, "goal"),
        ({"radius": 0.0}, "radius"),
        ({"likely": -0.1}, "likely"),
        ({"certain": 1.5}, "certain"),
        ({"likely": 0.5, "certain": 0.4}, "certain"),
        ({"hold_time": -1.0}, "hold_time"),
        ({"rest_speed": 0.0}, "rest_speed"),
    ],
)
def test_bad_input_is_named(arguments, name):
    with pytest.raises(InputError, match=name):
        EndDetector(PhaseFilter(Given(num_axes=2), SURE), **arguments)
