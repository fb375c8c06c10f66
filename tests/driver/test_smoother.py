import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.driver.limits import usable
from pace_drake.driver.robot import PERIOD
from pace_drake.safety.joint_limits import JOINT_LIMITS, JointLimits
from tests.driver.fake import START

pytest.importorskip("ruckig", reason="needs the extra 'driver'")

from pace_drake.driver import smoother as dut

FER = JOINT_LIMITS["fer"]
FR3 = JOINT_LIMITS["fr3"]


def check_limits(path: np.ndarray, limits: JointLimits) -> None:
    """What the robot checks of positions (n, 7) [rad] that come every millisecond, by differences."""
    velocity = np.diff(path, axis=0) / PERIOD
    acceleration = np.diff(velocity, axis=0) / PERIOD
    jerk = np.diff(acceleration, axis=0) / PERIOD
    assert np.all(path >= limits.lower)
    assert np.all(path <= limits.upper)
    assert np.all(np.abs(acceleration) <= limits.acceleration)
    assert np.all(np.abs(jerk) <= limits.jerk)
    assert np.all(np.abs(velocity) <= limits.velocity)
    if np.all(np.isfinite(limits.deceleration)):
        for sign, end in ((1.0, limits.upper), (-1.0, limits.lower)):
            distance = np.maximum(sign * (end - path[1:]), 0.0)
            allowed = np.sqrt(2.0 * np.array(limits.deceleration) * distance) - limits.velocity_offset
            assert np.all(sign * velocity <= np.maximum(allowed, 0.0))


def middle(limits: JointLimits) -> np.ndarray:
    return START if limits is FR3 else np.array([0.0, 0.3, 0.0, -1.57, 0.0, 1.57, 0.785])


@st.composite
def streams(draw):
    """Commands that jump, wander and pause: (cycles until it, stamp's distance [s], share of the range (7))."""
    size = draw(st.integers(1, 12))
    shares = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7)
    return [
        (draw(st.integers(1, 400)), draw(st.sampled_from([0.0, 0.001, 0.005, 0.02, 0.3])), draw(shares))
        for _ in range(size)
    ]


@pytest.mark.parametrize("limits", [FR3, FER], ids=["fr3", "fer"])
@settings(max_examples=60, deadline=None)
@given(stream=streams(), near=st.floats(0.001, 1.0), braking=st.booleans())
def test_the_robots_limits_are_kept_at_every_cycle_whatever_is_commanded(limits, stream, near, braking):
    least = usable(limits)
    smoother = dut.Smoother(least, middle(limits))
    path, stamp, position = [middle(limits)] * 4, 0.0, middle(limits)
    for cycles, interval, share in stream:
        stamp += interval
        target = least.lower + np.array(share) * (least.upper - least.lower)
        position = position + near * (target - position)
        smoother.command(position, stamp)
        path += [smoother.step() for _ in range(cycles)]
    if braking:
        smoother.brake()
    path += [smoother.step() for _ in range(4000)]
    check_limits(np.array(path), limits)
    assert smoother.at_rest()
    if not braking:
        np.testing.assert_allclose(path[-1], position, atol=1e-6)


def minimum_jerk(time, duration: float, distance: float):
    share = np.clip(np.asarray(time) / duration, 0.0, 1.0)
    return distance * (10 * share**3 - 15 * share**4 + 6 * share**5)


@pytest.mark.parametrize("limits", [FR3, FER], ids=["fr3", "fer"])
def test_a_stream_is_followed_closely_and_without_overshoot(limits):
    smoother = dut.Smoother(usable(limits), START)
    lag, path = [], [START]
    for cycle in range(3500):
        commanded = START + minimum_jerk(1e-3 * (cycle - cycle % 5), 3.0, 0.3)
        if cycle % 5 == 0 and cycle <= 3000:
            smoother.command(commanded, 1e-3 * cycle)
        path.append(smoother.step())
        lag.append(np.abs(path[-1] - commanded).max())
    assert max(lag) < 0.004
    assert np.max(path[-1] - START) <= 0.3 + 1e-6
    np.testing.assert_allclose(path[-1], START + 0.3, atol=1e-7)
    check_limits(np.array(path), limits)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_stream_that_ends_at_a_limit_does_not_pass_it(sign):
    least = usable(FER)
    end = least.upper if sign > 0 else least.lower
    smoother = dut.Smoother(least, end - 0.4 * sign)
    path = []
    for cycle in range(2000):
        if cycle % 5 == 0 and cycle <= 400:
            smoother.command(end - sign * (0.4 - 1e-3 * cycle), 1e-3 * cycle)
        path.append(smoother.step())
    assert np.max(sign * (np.array(path) - end)) < 1e-6


def test_the_last_command_is_held():
    smoother = dut.Smoother(usable(FR3), START)
    smoother.command(START + 0.02, 0.0)
    path = [smoother.step() for _ in range(2000)]
    np.testing.assert_allclose(path[1000:], np.tile(START + 0.02, (1000, 1)), atol=1e-9)


def test_it_stands_still_outside_the_limits_too():
    start = START.copy()
    start[0] = 2.745  # between the limit of targets and the robot's
    smoother = dut.Smoother(usable(FR3), start)
    np.testing.assert_allclose([smoother.step() for _ in range(500)], np.tile(start, (500, 1)), atol=1e-12)


def test_it_goes_on_from_where_the_robot_went_when_commands_were_lost():
    smoother = dut.Smoother(usable(FR3), START)
    smoother.command(START + 1.0, 0.0)
    path = [smoother.step() for _ in range(200)]
    # The robot keeps the acceleration for seven cycles without a command.
    velocity = (path[-1] - path[-2]) / PERIOD
    acceleration = (velocity - (path[-2] - path[-3]) / PERIOD) / PERIOD
    for _ in range(7):
        velocity = velocity + PERIOD * acceleration
        path.append(path[-1] + PERIOD * velocity)
    assert not smoother.follow(path[-8], velocity, acceleration)
    assert not smoother.follow(path[-9].astype(np.float32), velocity, acceleration)
    assert smoother.follow(path[-1], velocity, acceleration)
    path += [smoother.step(8 if k == 0 else 1) for k in range(3000)]
    check_limits(np.array(path), FR3)
    np.testing.assert_allclose(path[-1], START + 1.0, atol=1e-6)
