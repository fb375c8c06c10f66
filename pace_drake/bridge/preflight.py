"""What must be right before the arm may move."""

from dataclasses import dataclass

import numpy as np
from drake import lcmt_panda_status

from pace_drake.bridge.session import Session
from pace_drake.safety.joint_limits import JOINT_LIMITS


@dataclass(frozen=True)
class Check:
    """One thing that must be right."""

    name: str
    good: bool
    found: str
    """What was found, and what to do if it is not good."""


def preflight(session: Session) -> list[Check]:
    """Looks at the robot, its surroundings and the person; to be asked after a second of stepping.

    Args:
        session: connected.
    """
    config, output, station = session.scenario.lcm, session.simulation.output, session.station
    status_context = station.status.GetMyContextFromRoot(session.simulation.context)
    measured = output("panda.position_measured")
    beyond = JOINT_LIMITS[config.robot].beyond(measured)
    nearest = int(np.argmax(beyond))
    way = np.abs(measured - session.home)
    longest = int(np.argmax(way))
    skew = float(station.status.GetOutputPort("clock_skew").Eval(status_context)[0])
    age, mode = float(output("status_age")[0]), int(output("robot_mode")[0])
    others = station.watchdog.num_messages_of_others
    found = [
        Check("status", age <= config.status_timeout, f"{1e3 * age:.0f} ms old"),
        Check(
            "robot mode",
            mode == lcmt_panda_status.kMove,
            "Move" if mode == lcmt_panda_status.kMove else f"{mode}, not Move (2): release the robot",
        ),
        Check("clocks", abs(skew) <= config.max_clock_skew, f"{1e3 * skew:+.0f} ms apart; synchronise them if far"),
        Check(
            "nobody else commands",
            not others,
            f"{others} messages of another program on {config.panda_command_channel}: stop it" if others else "yes",
        ),
        Check(
            "joint limits",
            bool(beyond[nearest] < -config.limit_margin),
            f"joint {nearest + 1} is nearest, {-beyond[nearest]:.2f} rad away",
        ),
        Check(
            "way to the start",
            bool(way[longest] <= config.join_range) and session.scene.is_free(measured, session.home),
            f"joint {longest + 1} has {way[longest]:.2f} rad to go, at most {config.join_range:g}, and nothing may "
            "stand between",
        ),
    ]
    if session.person is not None:
        person_context = session.person.GetMyContextFromRoot(session.simulation.context)
        hand_age = float(session.person.GetOutputPort("hand_age").Eval(person_context)[0])
        what = f"{hand_age:.2f} s old" if np.isfinite(hand_age) else "no sample: start the tracker"
        found.append(Check("hand", hand_age <= session.scenario.safety.hand_timeout, what))
    return found
