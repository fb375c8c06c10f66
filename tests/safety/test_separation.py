"""The formulas against a hand and a braking robot played step by step; the rate they allow against a slow search."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.errors import InputError
from pace_drake.safety.config import SafetyConfig
from pace_drake.safety.separation import (
    REST_SPEED,
    allowed_rate,
    allowed_speed,
    contact_speed,
    protective_distance,
    turned_speed,
)

speeds = st.floats(0.01, 2.0)


def played_way(human_speed, robot_speed, reaction_time, deceleration, step=1e-4):
    """[m] by which hand and robot come nearer until the robot stands: it goes on, then brakes."""
    way, time, speed = 0.0, 0.0, robot_speed
    while speed > 0:
        way += (human_speed + speed) * step
        time += step
        if time > reaction_time:
            speed -= deceleration * step
    return way


@settings(max_examples=30, deadline=None)
@given(speeds, speeds, st.floats(0.02, 0.3), st.floats(1.0, 10.0))
def test_the_protective_distance_is_what_hand_and_braking_robot_need(v_h, v_r, reaction, deceleration):
    needed = protective_distance(v_h, v_r, reaction, deceleration, 0.11)
    assert needed == pytest.approx(0.11 + played_way(v_h, v_r, reaction, deceleration), abs=2e-3)


@settings(max_examples=100, deadline=None)
@given(speeds, speeds, st.floats(0.0, 0.3), st.floats(0.5, 10.0), st.floats(0.0, 0.3))
def test_the_allowed_speed_is_its_inverse(v_h, v_r, reaction, deceleration, margin):
    distance = protective_distance(v_h, v_r, reaction, deceleration, margin)
    assert allowed_speed(v_h, distance, reaction, deceleration, margin) == pytest.approx(v_r, abs=1e-6)


def test_published_figures():
    """a = 2.5 m/s^2, margins 0.11 m, d = 0.5 m: 0.29 m/s for 0.10 s, 0 for 0.25 s."""
    assert allowed_speed(1.6, 0.5, 0.10, 2.5, 0.11) == pytest.approx(0.29, abs=0.005)
    assert allowed_speed(1.6, 0.5, 0.25, 2.5, 0.11) == pytest.approx(0.0, abs=0.005)
    assert allowed_speed(1.6, 0.05, 0.1, 2.5, 0.11) == 0.0


def test_the_default_contact_speed_is_below_what_a_hand_bears():
    """Hand 0.6 kg, 75 N/mm; the Panda's moving mass halved is 8 kg."""
    quasi_static, transient = (contact_speed(force, 75e3, 0.6, 8.0) for force in (140.0, 280.0))
    assert quasi_static == pytest.approx(0.684, abs=0.001)
    assert transient == pytest.approx(2 * quasi_static)
    assert SafetyConfig().contact_speed < quasi_static


@given(st.floats(0.05, np.pi - 0.05), st.floats(0.0, 0.99), st.floats(0.1, 2.0))
def test_a_turned_direction_is_the_worst_within_the_angle(angle, sine, speed):
    within = angle + np.linspace(-1, 1, 4001) * np.arcsin(sine)
    worst = np.max(np.cos(within)) * speed
    assert turned_speed(speed, speed * np.cos(angle), sine) == pytest.approx(worst, abs=1e-4)
    assert turned_speed(speed, speed * np.cos(angle), 1.5) == speed


class Pairs:
    """One part and one limb, at one posture; a point that moves as given."""

    def __init__(self, distance, speed, towards, **config):
        self.config = SafetyConfig(**config)
        self.distance = np.array([[distance]])
        self.length = np.array([[[max(distance, 0.0) + 0.1]]])
        self.speed, self.towards = (np.full((1, 1, 1, 3), value) for value in (speed, towards))

    def rate(self, stop_time=0.25, joint=False):
        c = self.config
        return allowed_rate(
            self.distance, self.length, self.speed, self.towards, c.human_speed, c.reaction_time, c.period, stop_time,
            c.margin, c.contact_speed, c.stop_distance, joint,
        )  # fmt: skip


@pytest.mark.parametrize("speed", [0.2, 0.5, 1.5])
@pytest.mark.parametrize("distance", [0.1, 0.3, 0.45, 0.6, 0.9, 1.5])
def test_straight_at_a_hand_the_rate_is_that_of_the_formula(distance, speed):
    """Strict: rate times speed is the allowed speed, with a deceleration of speed / stop_time."""
    found = Pairs(distance, speed, speed, contact_speed=0.0).rate()
    expected = min(float(allowed_speed(1.6, distance, 0.11, speed / 0.25, 0.11)) / speed, 1.0)
    assert expected - 1 / 128 <= found <= expected + 1e-9 or (expected < REST_SPEED and found == 0)


def test_moving_away_is_allowed_at_any_distance():
    for distance in (-0.02, 0.0, 0.1, 0.5):
        assert Pairs(distance, 0.5, -0.5).rate() == 1.0
        strict = Pairs(distance, 0.5, -0.5, contact_speed=0.0).rate()
        # Strict: at rest within the reaction time, should the hand come round.
        assert strict >= (0.1 - 0.01) / 0.25 - 1 / 128
        assert (strict < 0.7) == (distance <= 0.0)


def test_inside_the_protective_distance_contact_speed_and_a_still_hand_limit():
    assert Pairs(0.4, 0.55, 0.55).rate() == 1.0
    assert Pairs(0.4, 1.3, 1.3).rate() == pytest.approx(0.5, abs=1 / 128)
    near = Pairs(0.1, 0.5, 0.5).rate()
    v = near * 0.5
    # Reaction, a period and the way to rest end short of the stop distance.
    assert v * 0.11 + v * near * 0.25 / 2 == pytest.approx(0.05, abs=0.005)
    assert Pairs(0.04, 0.5, 0.5).rate() == 0.0
    assert Pairs(0.04, 0.5, 0.5).rate(joint=True) == 1.0
    assert Pairs(0.04, 1.3, 1.3).rate(joint=True) == pytest.approx(0.5, abs=1 / 128)


@pytest.mark.parametrize("name", ["distance", "length", "speed", "towards"])
def test_nothing_is_allowed_where_a_figure_is_no_number(name):
    pairs = Pairs(1.5, 0.1, 0.1)
    assert pairs.rate() == 1.0
    getattr(pairs, name)[...] = np.nan
    assert pairs.rate() == 0.0
    assert pairs.rate(joint=True) == 0.0


@pytest.mark.parametrize(
    ("field", "value"),
    [("human_speed", -1.0), ("reaction_time", 0.0), ("period", 0.2), ("contact_speed", np.inf), ("hand_timeout", 0.0)],
)
def test_settings_that_cannot_be_used(field, value):
    with pytest.raises(InputError, match=rf"safety\.{field}: must be"):
        SafetyConfig(**{field: value}).validate()
