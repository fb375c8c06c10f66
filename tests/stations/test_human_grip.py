"""HumanGrip alone, its inputs put in from outside: when a key is taken, and what the hand does to it."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia

from pace_drake.stations.human_grip import HumanGrip

REACH = 0.05
MASS = (0.1, 0.2)
FAR = np.array([2.0, 0.0, 0.5])


@pytest.fixture(scope="module")
def bodies():
    plant = MultibodyPlant(0.01)
    added = [
        plant.AddRigidBody(f"key_{k}", SpatialInertia.SolidBoxWithMass(mass, 0.1, 0.02, 0.02))
        for k, mass in enumerate(MASS)
    ]
    plant.Finalize()
    # The plant owns them and lives as long as they are used.
    return plant, added


@pytest.fixture(scope="module")
def dut(bodies):
    return HumanGrip(bodies[1], REACH)


class Bench:
    def __init__(self, dut):
        self.dut, self.context = dut, dut.CreateDefaultContext()
        self.hand(FAR)
        for k in (1, 2):
            self.key(k, RigidTransform([0.3, 0.4, 0.0]))

    def hand(self, p_WH):
        self.dut.GetInputPort("p_WH").FixValue(self.context, p_WH)

    def key(self, k, X_WO, w=(0.0, 0.0, 0.0), v=(0.0, 0.0, 0.0)):
        state = np.concatenate([X_WO.rotation().ToQuaternion().wxyz(), X_WO.translation(), w, v])
        self.dut.GetInputPort(f"key_{k}").FixValue(self.context, state)

    def look(self):
        self.context.SetDiscreteState(self.dut.EvalUniquePeriodicDiscreteUpdate(self.context))
        return self.taken()

    def taken(self):
        return self.dut.GetOutputPort("key_taken").Eval(self.context).tolist()

    def forces(self):
        return self.dut.GetOutputPort("applied_spatial_force").Eval(self.context)


@pytest.fixture
def bench(dut):
    return Bench(dut)


#: Held up and turned, so that its short end is elsewhere than over its origin.
HELD = RigidTransform(RollPitchYaw(0.3, -0.8, 2.0), [0.7, 0.1, 0.35])
END = HELD @ HumanGrip.p_OEnd


def near(X_WO, distance):
    """A hand so far from the short end of a key there."""
    return X_WO @ HumanGrip.p_OEnd + distance * np.array([0.6, 0.0, 0.8])


def test_a_key_is_taken_by_its_short_end_when_the_hand_comes_within_reach(bench):
    bench.key(1, HELD)
    bench.hand(near(HELD, 1.001 * REACH))
    assert bench.look() == [0, 0]
    bench.hand(HELD @ (-HumanGrip.p_OEnd))  # at the other end: the key is longer than the reach
    assert bench.look() == [0, 0]
    assert bench.forces() == []
    bench.hand(near(HELD, 0.999 * REACH))
    assert bench.taken() == [0, 0]  # not before it is looked at
    assert bench.look() == [1, 0]


def test_who_is_never_near_takes_nothing(bench):
    bench.key(1, HELD)
    bench.key(2, HELD)
    for _ in range(50):
        bench.look()
    assert bench.taken() == [0, 0]
    assert bench.forces() == []


def test_a_key_on_the_table_is_not_taken(bench):
    lying = RigidTransform([0.7, 0.1, 0.0])
    bench.key(1, lying)
    bench.hand(near(lying, 0.0))
    assert bench.look() == [0, 0]


def test_the_hand_keeps_what_it_took_wherever_it_goes(bench):
    bench.key(1, HELD)
    bench.hand(END)
    bench.look()
    assert bench.look() == [1, 0]  # it is not taken twice
    bench.hand(FAR)
    bench.key(1, RigidTransform([0.3, 0.4, 0.0]))
    assert bench.look() == [1, 0]
    assert len(bench.forces()) == 1


def test_in_the_hand_and_at_rest_a_key_s_weight_is_borne_and_no_more(bench):
    bench.key(1, HELD)
    bench.hand(END)
    bench.look()
    (force,) = bench.forces()
    np.testing.assert_allclose(force.F_Bq_W.translational(), [0.0, 0.0, MASS[0] * 9.81], atol=1e-9)
    np.testing.assert_allclose(force.F_Bq_W.rotational(), 0.0, atol=1e-12)
    np.testing.assert_array_equal(force.p_BoBq_B, HumanGrip.p_OEnd)


def test_the_force_is_on_the_key_that_was_taken(bench, bodies):
    bench.key(2, HELD)
    bench.hand(END)
    assert bench.look() == [0, 1]
    (force,) = bench.forces()
    assert force.body_index == bodies[1][1].index()
    assert force.F_Bq_W.translational()[2] == pytest.approx(MASS[1] * 9.81)


@pytest.mark.parametrize("distance", [0.001, 0.03, 0.5, 5.0])
def test_the_pull_is_towards_the_hand_and_limited(bench, distance):
    bench.key(1, HELD)
    bench.hand(END)
    bench.look()
    bench.hand(near(HELD, distance))
    pull = bench.forces()[0].F_Bq_W.translational() - [0.0, 0.0, MASS[0] * 9.81]
    assert pull @ [0.6, 0.0, 0.8] == pytest.approx(np.linalg.norm(pull))
    assert 0 < np.linalg.norm(pull) <= 10.0 + 1e-9
    if distance < 0.01:  # the limit is far
        bench.hand(near(HELD, 2 * distance))
        more = bench.forces()[0].F_Bq_W.translational() - [0.0, 0.0, MASS[0] * 9.81]
        np.testing.assert_allclose(more, 2 * pull, atol=1e-9)
    if distance > 1:
        bench.hand(near(HELD, 2 * distance))
        more = bench.forces()[0].F_Bq_W.translational() - [0.0, 0.0, MASS[0] * 9.81]
        np.testing.assert_allclose(more, pull, atol=1e-9)


def test_motion_of_the_end_and_turning_are_damped(bench):
    bench.key(1, HELD)
    bench.hand(END)
    bench.look()
    weight = [0.0, 0.0, MASS[0] * 9.81]
    bench.key(1, HELD, v=(0.2, -0.1, 0.3))
    damping = bench.forces()[0].F_Bq_W.translational() - weight
    assert damping @ [0.2, -0.1, 0.3] == pytest.approx(-np.linalg.norm(damping) * np.linalg.norm([0.2, -0.1, 0.3]))
    w = np.array([0.0, 2.0, -1.0])
    bench.key(1, HELD, w=w)
    force = bench.forces()[0].F_Bq_W
    v_WEnd = np.cross(w, END - HELD.translation())
    assert (force.translational() - weight) @ v_WEnd < 0
    assert force.rotational() @ w < 0
    # Turning about its end, the end is at rest: only the turn is damped.
    bench.key(1, HELD, w=w, v=-v_WEnd)
    np.testing.assert_allclose(bench.forces()[0].F_Bq_W.translational(), weight, atol=1e-9)


def test_the_hand_holds_both_keys(bench):
    bench.key(1, HELD)
    bench.hand(END)
    bench.look()
    other = RigidTransform(RollPitchYaw(0.0, 0.5, 0.0), [0.7, -0.3, 0.3])
    bench.key(2, other)
    hand = near(other, 0.02)
    bench.hand(hand)
    assert bench.look() == [1, 2]
    first, second = (
        force.F_Bq_W.translational() - [0, 0, m * 9.81] for force, m in zip(bench.forces(), MASS, strict=True)
    )
    for pull, target, end in ((first, hand, END), (second, hand, other @ HumanGrip.p_OEnd)):
        towards = (target - end) / np.linalg.norm(target - end)
        assert pull @ towards == pytest.approx(np.linalg.norm(pull))
        assert np.linalg.norm(pull) > 0.1


def test_the_length_of_the_quaternion_does_not_matter(bench):
    """The plant's time stepping does not keep it at 1: it grows while a key swings."""
    bench.key(1, HELD, w=(0.0, 2.0, -1.0), v=(0.1, 0.0, 0.2))
    bench.hand(END)
    bench.look()
    bench.hand(near(HELD, 0.02))
    unit = bench.forces()[0].F_Bq_W.get_coeffs().copy()
    port = bench.dut.GetInputPort("key_1")
    state = port.Eval(bench.context).copy()
    state[:4] *= 1.5
    port.FixValue(bench.context, state)
    np.testing.assert_allclose(bench.forces()[0].F_Bq_W.get_coeffs(), unit, atol=1e-9)
