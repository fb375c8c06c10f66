"""The path's clock against a sum of small steps, and what must hold whenever it is led."""

from math import inf

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from pace_drake.systems.path_clock import PathClock

rates = st.integers(0, 100).map(lambda percent: percent / 100)


@st.composite
def clocks(draw):
    duration = draw(st.floats(0.1, 20.0))
    passed = draw(st.floats(0.0, duration))
    return PathClock(
        duration,
        draw(st.floats(0.0, 100.0)),
        passed,
        draw(rates),
        draw(rates),
        draw(st.just(0.0) | st.floats(0.05, 2.0)),
    )


def summed(clock, time, steps=20_000):
    """Path time [s]: the rate, written out, summed over midpoints."""
    t = (np.arange(steps) + 0.5) / steps * (time - clock.since)
    change = np.minimum(t / clock.stop_time if clock.stop_time else 1.0, abs(clock.aim - clock.rate))
    rate = np.full(steps, clock.rate) + np.sign(clock.aim - clock.rate) * change
    return min(clock.passed + rate.mean() * (time - clock.since), clock.duration)


@given(clocks(), st.floats(0.001, 10.0) | st.floats(0.1, 0.9).map(lambda share: -share))
def test_it_is_the_integral_of_the_rate(clock, after):
    if after < 0:  # a share of the ramp
        after *= -clock.ramp
    path, rate = clock.at(clock.since + after)
    assert path == pytest.approx(summed(clock, clock.since + after), abs=2e-3)
    assert min(clock.rate, clock.aim) <= rate <= max(clock.rate, clock.aim)
    if after >= clock.ramp + 1e-9:
        assert rate == clock.aim


@given(clocks())
@example(
    PathClock(1.0, 3.0, 1.0, 0.0, 1.0, 0.25)
)  # held at its end, where it waits for the arm or the hand, and let go
def test_its_end_is_where_the_path_ends(clock):
    if clock.end == inf:
        assert clock.aim == 0
        assert clock.at(clock.since + 1e3)[0] <= clock.duration
        return
    assert clock.end >= clock.since
    assert clock.at(clock.end)[0] == pytest.approx(clock.duration, abs=1e-9)
    if clock.passed == clock.duration:  # held there it has no end
        assert clock.end == clock.since
    before = clock.end - 0.01
    if before > clock.since:
        assert clock.at(before)[0] < clock.duration


@given(clocks(), st.lists(st.tuples(st.floats(0.0, 3.0), rates), max_size=6))
def test_whenever_it_is_led_nothing_jumps(clock, leads):
    clock, time = clock._replace(stop_time=max(clock.stop_time, 0.05)), clock.since
    for wait, aim in leads:
        time += wait
        before = clock.at(time)
        clock = clock.led(time, aim)
        assert clock.at(time) == before
        assert (clock.since, clock.aim) == (time, aim)
        late = clock.at(time + 1e-6)
        assert 0.0 <= late[0] - before[0] <= 1.1e-6
        assert abs(late[1] - before[1]) <= 1.1e-6 / clock.stop_time


def test_held_and_let_go_it_loses_the_ramps_and_the_time_between():
    clock = PathClock(10.0, 0.0, 0.0, 1.0, 1.0, 0.25)
    assert clock.end == 10.0
    held = clock.led(2.0, 0.0)
    assert held.end == inf
    assert held.at(5.0) == (2.125, 0.0)
    assert held.led(5.0, 1.0).end == pytest.approx(5.0 + 0.25 + 10.0 - 2.25)
    # Held shortly before its end it still comes to it.
    assert clock.led(9.9, 0.0).end == pytest.approx(9.9 + 0.25 * (1 - np.sqrt(1 - 0.8)))
