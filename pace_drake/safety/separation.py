"""Speed and separation monitoring, power and force limiting: the formulas (ISO/TS 15066), and the rate they allow.

All of it stands in one file, because numba's cache does not notice that a function in another file has changed.
"""

from math import sqrt

import numpy as np
from numba import njit
from numba.extending import register_jitable

#: [m/s] a part that closes in more slowly counts as at rest.
REST_SPEED = 5e-4
#: Bisections of the rate: it comes in steps of 1/128.
_BISECTIONS = 7


@register_jitable
def protective_distance(human_speed, robot_speed, reaction_time, deceleration, margin):
    """Returns S_p = S_h + S_r + S_s + C + Z_d + Z_r [m], with T_s = v_r / a.

    Args:
        human_speed: v_h [m/s] towards the robot.
        robot_speed: v_r [m/s] towards the human, >= 0.
        reaction_time: T_r [s] in which the robot goes on at v_r.
        deceleration: a [m/s^2] with which it comes to rest afterwards.
        margin: C + Z_d + Z_r [m].
    """
    stop_time = robot_speed / deceleration
    human_way = human_speed * (reaction_time + stop_time)
    return human_way + robot_speed * reaction_time + robot_speed**2 / (2 * deceleration) + margin


def allowed_speed(human_speed, distance, reaction_time, deceleration, margin):
    """Returns the v_r [m/s] whose protective distance is ``distance`` [m]; 0 where none is so short."""
    per_reaction = deceleration * reaction_time
    square = human_speed**2 + per_reaction**2 - 2 * deceleration * (margin - distance)
    return np.maximum(np.sqrt(np.maximum(square, 0.0)) - per_reaction - human_speed, 0.0)


def contact_speed(force, stiffness, human_mass, robot_mass):
    """Returns v = F_T / sqrt(mu k) [m/s]: how fast a contact may be (power and force limiting).

    Args:
        force: F_T [N] that the body part bears.
        stiffness: k [N/m] of the body part.
        human_mass: m_H [kg] of the body part.
        robot_mass: m_R [kg] effective mass of the robot.
    """
    reduced_mass = 1 / (1 / human_mass + 1 / robot_mass)
    return force / np.sqrt(reduced_mass * stiffness)


@register_jitable
def turned_speed(speed, towards, sine):
    """Returns the closing speed [m/s] after the direction to the hand has turned, in the worst sense.

    Args:
        speed: [m/s] of a point.
        towards: [m/s] its part towards the hand.
        sine: of the angle by which the direction turns at most; 1 and more: by any.
    """
    if speed <= 0.0 or sine >= 1.0:
        return speed
    cosine = min(max(towards / speed, -1.0), 1.0)
    other = sqrt(1.0 - sine * sine)
    if cosine >= other:
        return speed
    return speed * (cosine * other + sqrt(1.0 - cosine * cosine) * sine)


@register_jitable
def _is_allowed(
    rate,
    distance,
    length,
    speed,
    towards,
    human_speed,
    reaction_time,
    period,
    stop_time,
    margin,
    contact,
    stop_distance,
    joint,
):
    """Whether all pairs may go on at ``rate``."""
    num_postures, num_parts, num_limbs, num_points = speed.shape
    # So far a hand goes at most while the robot comes to rest, and until it is as slow as to rest within the reaction
    # time.
    hand_way = human_speed * (period + rate * stop_time)
    short_way = human_speed * (period + max(rate * stop_time - (reaction_time - period), 0.0))
    for i in range(num_parts):
        for j in range(num_limbs):
            soon = directed = turned = 0.0
            for k in range(num_postures):
                gap = max(length[k, i, j], 1e-9)
                for e in range(num_points):
                    size, along = speed[k, i, j, e], towards[k, i, j, e]
                    directed = max(directed, along)
                    turned = max(turned, turned_speed(size, along, hand_way / gap))
                    soon = max(soon, turned_speed(size, along, short_way / gap))
            if rate * turned <= REST_SPEED:
                continue
            d = distance[i, j]
            needed = protective_distance(human_speed, rate * turned, reaction_time + period, turned / stop_time, margin)
            if d >= needed:
                continue
            # Inside the protective distance: as slowly as a contact may be, and able to stop short of a still hand.
            floor = REST_SPEED
            if contact > 0.0 and rate * directed > REST_SPEED:
                still = protective_distance(
                    0.0, rate * directed, reaction_time + period, directed / stop_time, stop_distance
                )
                if joint or d >= still:
                    floor = max(floor, contact)
            # Passing by and moving away, too: should the hand come round to the front, the robot closes in no faster
            # than that, or is as slow by then as to rest within the reaction time.
            if rate * directed <= floor and (
                rate * stop_time <= reaction_time - period or rate * soon <= max(contact, REST_SPEED)
            ):
                continue
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def allowed_rate(
    distance, length, speed, towards, human_speed, reaction_time, period, stop_time, margin, contact, stop_distance,
    joint,
):  # fmt: skip
    """Returns the path rate in [0, 1], in steps of 1/128, at which every part of the robot keeps its distance.

    A part may go on at rate r if its distance is the protective one at least, for the greatest closing speed along
    the path ahead, the hand going anywhere meanwhile; or if it does not close in on the hand faster than allowed
    inside the protective distance. Where any figure is no number, the rate is 0.

    Args:
        distance: (I, J) [m] between robot parts and limbs now.
        length: (K, I, J) [m] between their axes, at K postures along the path ahead.
        speed: (K, I, J, E) [m/s] of points of the parts at path rate 1.
        towards: (K, I, J, E) [m/s] their speeds towards the limb.
        human_speed, reaction_time, margin: see ``protective_distance``.
        period: [s] between two looks.
        stop_time: [s] in which the rate falls from 1 to 0; the deceleration is so speed / stop_time.
        contact: [m/s] allowed closing speed inside the protective distance, if the robot can still stop
        stop_distance: [m] short of a hand that keeps still, or
        joint: if contact is intended.
    """
    # Comparisons with what is no number would let it pass.
    if not (
        np.all(np.isfinite(distance))
        and np.all(np.isfinite(length))
        and np.all(np.isfinite(speed))
        and np.all(np.isfinite(towards))
    ):
        return 0.0
    if _is_allowed(
        1.0, distance, length, speed, towards, human_speed, reaction_time, period, stop_time, margin, contact,
        stop_distance, joint,
    ):  # fmt: skip
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if _is_allowed(
            middle, distance, length, speed, towards, human_speed, reaction_time, period, stop_time, margin, contact,
            stop_distance, joint,
        ):  # fmt: skip
            low = middle
        else:
            high = middle
    return low
