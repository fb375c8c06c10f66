"""``pace driver``: the driver between LCM and a Franka robot."""

import gc
import signal
import sys
import threading
from typing import TYPE_CHECKING

import click

from pace_drake.cli.options import lcm_url_option
from pace_drake.errors import InputError, require

if TYPE_CHECKING:
    from pace_drake.driver.hand import Hand
    from pace_drake.driver.robot import Robot


@click.command("driver", short_help="Drive a Franka robot (FR3 or FER) from LCM commands.")
@click.option("--robot", required=True, help="fr3, or fer (the Panda).")
@click.option("--ip", required=True, help="Address of the robot.")
@lcm_url_option
@click.option("--status-rate", type=float, default=500.0, show_default=True, help="Status messages, 200 to 1000 [Hz].")
@click.option(
    "--recover",
    type=click.Choice(["auto", "never"]),
    default="auto",
    show_default=True,
    help="After a reflex: recover, or wait until somebody has. Either way it then holds the position.",
)
@click.option("--recover-delay", type=float, default=1.0, show_default=True, help="From reflex to recovery [s].")
@click.option(
    "--start-tolerance",
    type=float,
    default=0.05,
    show_default=True,
    help="A first command must be this near the measured position, per joint; up to 0.2 [rad].",
)
@click.option("--expiry", type=float, default=0.1, show_default=True, help="Greatest |clock - stamp| of a command [s].")
@click.option(
    "--hand",
    type=click.Choice(["franka", "simulated", "none"]),
    default="franka",
    show_default=True,
    help="The Franka Hand; a simulated one, that only says it moves; or none.",
)
@click.option("--realtime/--no-realtime", default=True, help="Whether a real-time kernel is required; default yes.")
def command(
    robot: str,
    ip: str,
    url: str,
    status_rate: float,
    recover: str,
    recover_delay: float,
    start_tolerance: float,
    expiry: float,
    hand: str,
    realtime: bool,
) -> None:
    """Move a Franka robot as PANDA_COMMAND says, and report on PANDA_STATUS.

    The messages are those of the TRI driver drake-franka-driver, in position mode; the hand's are PANDA_HAND_COMMAND
    and PANDA_HAND_STATUS. It holds the position until commands come, survives reflexes, and stops within the robot's
    limits on Ctrl-C. This is a research aid and no safety function: keep the emergency stop at hand.
    """
    from pace_drake.driver.config import DriverConfig
    from pace_drake.driver.limits import usable
    from pace_drake.lcm.config import LcmConfig
    from pace_drake.lcm.url import open_lcm
    from pace_drake.safety.joint_limits import JOINT_LIMITS

    require(robot in JOINT_LIMITS, "--robot", f"{robot!r} is unknown: choose {' or '.join(JOINT_LIMITS)}")
    limits = usable(JOINT_LIMITS[robot])
    config = DriverConfig(
        status_rate=status_rate,
        expiry=expiry,
        start_tolerance=start_tolerance,
        recover=recover == "auto",
        recover_delay=recover_delay,
    )
    channels = LcmConfig(url=url)
    lcm = open_lcm(channels)
    fingers = _make_hand(hand, ip)
    arm = _make_robot(robot, ip, realtime)

    # After the packages, so that the extra is what an absent one is blamed on.
    from pace_drake.driver.arm import ArmDriver
    from pace_drake.driver.hand import HandDriver
    from pace_drake.driver.robot import ConnectionLost

    # A thread that wants Python's lock gets it after this time. With the default, 5 ms, the hand hardly gets a turn.
    sys.setswitchinterval(1e-4)
    # What has been imported is no garbage; to look through it takes longer than the robot waits.
    gc.freeze()
    stop = _Stop()
    driver = ArmDriver(arm, lcm, limits, channels=channels, config=config, report=_report)
    stopping = lambda: stop.signal is not None  # noqa: E731
    hand_thread = None
    if fingers is not None:
        # A second LCM: one is for one thread.
        hand_driver = HandDriver(fingers, open_lcm(channels), channels=channels, report=_report)
        hand_thread = threading.Thread(target=hand_driver.run, args=[stopping], daemon=True)
        hand_thread.start()
    try:
        driver.run(stopping)
    except ConnectionLost as error:
        raise InputError(f"no robot at {ip} ({error}): check --ip, --robot, and that FCI is active") from error
    finally:
        stop.signal = stop.signal or signal.SIGTERM
        if hand_thread is not None:
            hand_thread.join(timeout=2.0)
    if stop.signal == signal.SIGINT:
        raise KeyboardInterrupt("the robot stands still")
    _report("stopped; the robot stands still")


class _Stop:
    """Takes note of SIGINT and SIGTERM, so that the robot is stopped within its limits before the process ends."""

    def __init__(self) -> None:
        self.signal: int | None = None
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._handle)

    def _handle(self, number: int, _: object) -> None:
        self.signal = number


def _report(line: str) -> None:
    click.echo(f"pace driver: {line}", err=True)


def _make_hand(kind: str, ip: str) -> "Hand | None":
    if kind == "none":
        return None
    from pace_drake.driver.hand import FrankaHand, SimulatedHand

    if kind == "simulated":
        _report("the hand is SIMULATED: its status is what was commanded")
        return SimulatedHand()
    return FrankaHand(ip)


def _make_robot(robot: str, ip: str, realtime: bool) -> "Robot":
    import importlib.util

    if importlib.util.find_spec("ruckig") is None:
        raise InputError("pace driver needs ruckig: pip install 'pace_drake[driver]'")
    if robot == "fer":
        from pace_drake.driver.fer import Fer

        return Fer(ip, realtime=realtime)
    from pace_drake.driver.fr3 import Fr3

    return Fr3(ip, realtime=realtime)
