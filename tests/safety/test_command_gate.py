from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pace_drake.safety.command_gate import CommandGate, GateInput, GateMode, GateState, Refusal
from pace_drake.safety.joint_limits import JOINT_LIMITS

PERIOD = 0.005
HOME = np.array([0.0, -0.6, 0.0, -2.2, 0.0, 1.6, 0.8])
LIMITS = JOINT_LIMITS["fer"]


def gate(**changes) -> CommandGate:
    return CommandGate(limits=LIMITS, period=PERIOD, **changes)


class Rig:
    """A gate, an arm that does at once what it is told, and a log of what was sent."""

    def __init__(self, measured=HOME, **changes):
        self.gate, self.state = gate(**changes), GateState()
        self.seen = GateInput(reference=HOME, measured=np.array(measured), ready=True, fault=False, enable=False)
        self.sent: list[np.ndarray] = []
        self.modes: list[GateMode] = []

    def tick(self, count=1, **changes):
        for _ in range(count):
            self.seen = replace(self.seen, **changes)
            self.state = self.gate.tick(self.state, self.seen)
            self.modes.append(self.state.mode)
            if self.state.mode != GateMode.SILENT:
                self.sent.append(self.state.position)
                self.seen = replace(self.seen, measured=self.state.position)
        return self.state.mode

    def enable(self):
        self.tick(enable=False)
        return self.tick(enable=True)

    def follow(self):
        self.enable()
        for _ in range(10_000):
            if self.tick() == GateMode.FOLLOWING:
                return self
        raise AssertionError("never followed")


def assert_within_limits(sent, limits=LIMITS):
    q = np.array(sent)
    q = np.vstack([q[:1], q[:1], q[:1], q])  # at rest before
    v = np.diff(q, axis=0) / PERIOD
    a = np.diff(v, axis=0) / PERIOD
    j = np.diff(a, axis=0) / PERIOD
    assert np.all((q >= limits.lower) & (q <= limits.upper))
    for series, bound in ((v, limits.velocity), (a, limits.acceleration), (j, limits.jerk)):
        assert np.all(np.abs(series) <= bound * (1 + 1e-5) + 1e-6)


def test_it_is_silent_until_it_has_leave():
    rig = Rig()
    assert rig.tick(100) == GateMode.SILENT
    assert not rig.sent


def test_the_first_command_is_the_measured_position_and_the_way_is_slow():
    rig = Rig(HOME + 0.3)
    rig.enable()
    np.testing.assert_array_equal(rig.sent[0], HOME + 0.3)
    rig.follow()
    np.testing.assert_allclose(rig.sent[-1], HOME, atol=1e-12)
    speed = np.abs(np.diff(rig.sent, axis=0)).max(axis=0) / PERIOD
    assert 0.099 < (speed / LIMITS.velocity).max() < 0.101  # the slowest joint sets the pace
    assert_within_limits(rig.sent)


def test_leave_counts_once():
    rig = Rig().follow()
    rig.tick(ready=False)
    assert rig.tick(100, ready=True) == GateMode.SILENT  # leave is still there, but it does not rise
    assert rig.enable() == GateMode.JOINING


def test_leave_given_during_a_fault_is_used_when_the_fault_is_over():
    rig = Rig()
    rig.tick(fault=True)
    assert rig.tick(enable=True) == GateMode.SILENT
    assert rig.tick(fault=False) == GateMode.JOINING


def test_leave_that_has_ended_is_not_used():
    rig = Rig()
    rig.tick(fault=True, enable=True)
    rig.tick(enable=False)
    assert rig.tick(100, fault=False) == GateMode.SILENT


def test_it_passes_the_reference_on_unchanged():
    rig = Rig().follow()
    for k in range(200):
        reference = HOME + 0.2 * (1 - np.cos(0.01 * k))
        rig.tick(reference=reference)
        np.testing.assert_array_equal(rig.sent[-1], reference)
    assert rig.state.mode == GateMode.FOLLOWING


@pytest.mark.parametrize(
    ("reference", "refusal", "joint"),
    [
        (HOME + np.eye(7)[2] * 0.5, Refusal.VELOCITY, 3),
        (HOME + np.eye(7)[2] * 0.0005, Refusal.ACCELERATION, 3),
        (np.where(np.arange(7) == 4, np.nan, HOME), Refusal.NOT_FINITE, 5),
        (np.where(np.arange(7) == 4, np.inf, HOME), Refusal.NOT_FINITE, 5),
    ],
)
def test_a_jump_is_refused_before_it_is_sent_and_the_arm_stays(reference, refusal, joint):
    rig = Rig().follow()
    before = len(rig.sent)
    assert rig.tick(reference=reference) == GateMode.BRAKING
    assert (rig.state.refusal, rig.state.joint, rig.state.num_refusals) == (refusal, joint, 1)
    rig.tick(300, reference=HOME)
    assert rig.state.mode == GateMode.BRAKING
    np.testing.assert_allclose(rig.sent[before:], np.tile(HOME, (301, 1)))


def test_jerk_is_refused():
    rig = Rig(measured=HOME).follow()
    rig.gate = replace(rig.gate, limits=replace(LIMITS, jerk=LIMITS.jerk / 100))
    rig.tick(reference=HOME + 0.3 * LIMITS.acceleration * PERIOD**2)
    assert rig.state.refusal == Refusal.JERK


def test_it_brakes_before_a_position_limit():
    rig = Rig().follow()
    velocity, q = 0.0, HOME.copy()
    while rig.state.mode == GateMode.FOLLOWING:
        velocity = min(velocity + 0.2 * LIMITS.acceleration[1] * PERIOD, 1.0)
        q = q + np.eye(7)[1] * velocity * PERIOD
        rig.tick(reference=q)
    assert rig.state.refusal == Refusal.POSITION
    assert rig.state.joint == 2
    rig.tick(200)
    assert LIMITS.upper[1] - 0.3 < rig.sent[-1][1] <= LIMITS.upper[1] - rig.gate.margin
    assert_within_limits(rig.sent)


def test_a_fault_brakes_within_the_limits_and_leave_leads_back():
    rig = Rig().follow()
    q = HOME
    for k in range(100):
        q = HOME + 0.1 * np.array([1, -1, 1, 1, -1, 1, 1]) * (1 - np.cos(0.02 * k))
        rig.tick(reference=q)
    assert rig.tick(fault=True) == GateMode.BRAKING
    at_fault = rig.sent[-1]
    rig.tick(200)
    assert 1e-3 < np.abs(rig.sent[-1] - at_fault).max() < 0.1
    assert rig.state.num_refusals == 0
    rig.tick(fault=False)
    assert rig.enable() == GateMode.JOINING
    rig.follow()
    np.testing.assert_allclose(rig.sent[-1], q)
    assert_within_limits(rig.sent)


def test_an_arm_that_parts_from_what_is_held_silences_the_gate():
    rig = Rig().follow()
    rig.tick(fault=True)
    pushed = HOME + 0.05
    for _ in range(99):  # the half second in which a lagging arm may catch up
        rig.tick(measured=pushed)
    assert rig.state.mode == GateMode.BRAKING
    rig.tick(measured=pushed)
    assert rig.tick(measured=pushed) == GateMode.SILENT
    rig.tick(fault=False)
    assert rig.enable() == GateMode.JOINING
    np.testing.assert_array_equal(rig.sent[-1], pushed)


@pytest.mark.parametrize(
    ("measured", "refusal"),
    [
        (HOME + 1.2, Refusal.TOO_FAR),
        (np.full(7, np.nan), Refusal.NOT_FINITE),
        (np.where(np.arange(7) == 6, LIMITS.upper, HOME), Refusal.TOO_FAR),
        (np.where(np.arange(7) == 1, LIMITS.lower + 0.01, HOME), Refusal.TOO_FAR),
    ],
)
def test_a_way_that_cannot_be_taken_is_refused(measured, refusal):
    rig = Rig(measured)
    assert rig.enable() == GateMode.SILENT
    assert rig.state.refusal == refusal
    assert not rig.sent


def test_an_arm_at_its_limit_is_refused():
    reference = np.where(np.arange(7) == 6, LIMITS.upper - 0.5, HOME)
    rig = Rig(np.where(np.arange(7) == 6, LIMITS.upper - 0.01, HOME))
    rig.tick(reference=reference)
    rig.enable()
    assert (rig.state.refusal, rig.state.joint) == (Refusal.POSITION, 7)


def test_an_obstructed_way_is_refused():
    asked = []

    def is_free(start, end):
        asked.append((start, end))
        return False

    rig = Rig(HOME + 0.1, is_free=is_free)
    rig.enable()
    assert rig.state.refusal == Refusal.OBSTRUCTED
    np.testing.assert_array_equal(asked, [(HOME + 0.1, HOME)])


def test_a_reference_that_moves_meanwhile_is_joined_again():
    rig = Rig(HOME + 0.2)
    rig.enable()
    rig.tick(50, reference=HOME + 0.05)
    rig.follow()
    np.testing.assert_allclose(rig.sent[-1], HOME + 0.05)
    assert_within_limits(rig.sent)


def test_a_moving_arm_is_not_driven_on_after_time_was_lost():
    rig = Rig().follow()
    for k in range(50):
        rig.tick(reference=HOME + 0.1 * (1 - np.cos(0.02 * k)))
    held = rig.sent[-1]
    assert rig.tick(lost=True) == GateMode.SILENT
    assert rig.state.num_losses == 1
    rig.tick(10, lost=False)
    np.testing.assert_array_equal(rig.sent[-1], held)
    before = len(rig.sent)
    rig.enable()
    rig.follow()
    assert_within_limits(rig.sent[before:])


def test_time_lost_at_rest_is_no_loss():
    rig = Rig().follow()
    rig.tick(5)
    assert rig.tick(lost=True) == GateMode.FOLLOWING
    assert rig.state.num_losses == 0


def test_the_vector_holds_all_of_the_state():
    rig = Rig(HOME + 0.3)
    rig.tick(ready=True)
    for _ in range(3):
        rig.enable()
        rig.tick(17)
        rig.tick(fault=True)
        vector = rig.state.vector()
        np.testing.assert_array_equal(GateState.from_vector(vector).vector(), vector)
        a, b = (rig.gate.tick(s, rig.seen) for s in (rig.state, GateState.from_vector(vector)))
        np.testing.assert_array_equal(a.vector(), b.vector())
        rig.tick(fault=False)
    assert rig.state.mode == GateMode.BRAKING


@pytest.mark.parametrize("robot", ["fer", "fr3"])
@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    jump=st.sampled_from([0.0, 1e-4, 1e-2, 1.0]),
    faults=st.booleans(),
)
def test_whatever_is_asked_nothing_outside_the_limits_is_sent(robot, seed, jump, faults):
    """Every stream between two silences is smooth, and starts where the arm is measured."""
    rng = np.random.default_rng(seed)
    limits = JOINT_LIMITS[robot]
    rig = Rig(HOME + rng.uniform(-0.3, 0.3, 7))
    rig.gate = replace(rig.gate, limits=limits)
    phase, pace = rng.uniform(0, 6, 7), rng.uniform(0, 3, 7)
    streams: list[list[np.ndarray]] = [[]]
    for k in range(1500):
        reference = HOME + 0.6 * np.sin(phase + pace * k * PERIOD * min(k / 400, 1.0))
        if rng.random() < 0.01:
            reference = reference + jump * rng.normal(size=7)
        if rng.random() < 0.002:
            reference = np.full(7, np.nan)
        measured = rig.seen.measured
        mode = rig.tick(
            reference=reference,
            ready=bool(rng.random() > 0.002),
            fault=bool(faults and rng.random() < 0.005),
            enable=bool(k % 100 < 50),
        )
        if mode == GateMode.SILENT:
            streams.append([])
        else:
            if not streams[-1]:
                np.testing.assert_array_equal(rig.sent[-1], measured)
            streams[-1].append(rig.sent[-1])
    for stream in streams:
        if stream:
            assert_within_limits(stream, limits)
