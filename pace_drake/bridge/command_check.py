"""Were the commands of a run within the limits? Judged from its LCM log alone, independently of what sent them."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from drake import lcmt_panda_command, lcmt_panda_status

from pace_drake.bridge.lcm_log import LoggedMessage
from pace_drake.lcm.config import LcmConfig
from pace_drake.safety.joint_limits import JOINT_LIMITS, NUM_JOINTS

#: [s] without a command after which the next one begins a new stream.
NEW_STREAM = 0.1
#: [rad] by which the first command of a stream may differ from the measured position.
MAX_START_ERROR = 1e-3
#: What rounding may add to a limit, as a share of it: positions of 3 rad, differenced three times.
_SLACK = 1e-4


@dataclass
class CommandCheck:
    """What a log says of the commands that were sent.

    A stream is a run of commands without a gap. Between two of them lies the command period, whenever the network took
    them, so that is what velocity, acceleration and jerk are reckoned with; before its first command an arm is at rest.
    """

    num_commands: int = 0
    num_streams: int = 0
    position: float = np.inf
    """[rad] least distance of a commanded position from its limit."""
    velocity: float = 0.0
    """[-] largest share of the velocity limit."""
    acceleration: float = 0.0
    """[-] likewise."""
    jerk: float = 0.0
    """[-] likewise."""
    start: float = 0.0
    """[rad] largest distance of the first command of a stream from the position measured before it."""
    tracking: float = 0.0
    """[rad] largest distance between a measured position and the command before it."""
    tracking_rms: float = 0.0
    """[rad]"""
    driver: float = 0.0
    """[rad] largest distance between the position that the driver asks of the robot and the command before it."""
    driver_rms: float = 0.0
    """[rad]"""
    wrong: list[str] = field(default_factory=list)
    """One line for each command that is none: not seven joints, not finite, another control mode."""

    @property
    def kept(self) -> bool:
        """Whether every command was within the limits, and every stream began where the arm was."""
        shares = (self.velocity, self.acceleration, self.jerk)
        return not self.wrong and self.position > 0 and max(shares) <= 1 + _SLACK and self.start <= MAX_START_ERROR

    def to_json(self) -> dict:
        """For summary.json."""
        position = self.position if np.isfinite(self.position) else None
        return {"kept": self.kept, **asdict(self), "position": position}


def check_commands(messages: Iterable[LoggedMessage], config: LcmConfig) -> CommandCheck:
    """Looks at every command in a log.

    Args:
        messages: of the log.
        config: channels, robot and command rate.
    """
    found = CommandCheck()
    streams: list[list[np.ndarray]] = []
    last_time, measured = -np.inf, None
    squares: dict[str, list[float]] = {"tracking": [], "driver": []}
    for message in messages:
        if message.channel == config.panda_status_channel:
            try:
                status = lcmt_panda_status.decode(message.data)
            except (ValueError, struct.error):
                continue  # what cannot be decoded was no status for the bridge either
            if len(status.joint_position) != NUM_JOINTS or not np.all(np.isfinite(status.joint_position)):
                continue
            measured = np.array(status.joint_position)
            if streams and message.time - last_time < NEW_STREAM:
                for name, joints in (("tracking", status.joint_position), ("driver", status.joint_position_desired)):
                    if len(joints) == NUM_JOINTS:
                        error = float(np.max(np.abs(np.array(joints) - streams[-1][-1])))
                        squares[name].append(error**2)
                        setattr(found, name, max(getattr(found, name), error))
        elif message.channel == config.panda_command_channel:
            command = lcmt_panda_command.decode(message.data)
            position = np.array(command.joint_position)
            found.num_commands += 1
            if (
                position.shape != (NUM_JOINTS,)
                or not np.all(np.isfinite(position))
                or command.control_mode_expected != lcmt_panda_status.CONTROL_MODE_POSITION
                or command.num_joint_velocity
                or command.num_joint_torque
            ):
                found.wrong.append(f"command {found.num_commands} at {message.time:.3f} s is no position command")
                continue
            if message.time - last_time >= NEW_STREAM:
                streams.append([])
                if measured is None:
                    found.wrong.append("commands before the first status")
                else:
                    found.start = max(found.start, float(np.max(np.abs(position - measured))))
            streams[-1].append(position)
            last_time = message.time
    found.num_streams = len(streams)
    for name, values in squares.items():
        setattr(found, f"{name}_rms", float(np.sqrt(np.mean(values))) if values else 0.0)
    for stream in streams:
        _examine(found, np.array(stream), config)
    return found


def _examine(found: CommandCheck, positions: np.ndarray, config: LcmConfig) -> None:
    """Looks at one stream (n, 7) [rad]."""
    limits, rate = JOINT_LIMITS[config.robot], config.command_rate
    found.position = min(found.position, -float(np.max(limits.beyond(positions))))
    series = np.vstack([np.repeat(positions[:1], 3, axis=0), positions])
    for name in ("velocity", "acceleration", "jerk"):
        series = np.diff(series, axis=0) * rate
        share = float(np.max(np.abs(series) / getattr(limits, name)))
        setattr(found, name, max(getattr(found, name), share))


def command_differences(recorded: Sequence[LoggedMessage], sent: Sequence[LoggedMessage]) -> np.ndarray:
    """(n) [rad] largest joint difference of each command sent from those that were recorded around its time."""
    times = [np.array([message.time for message in messages]) for messages in (recorded, sent)]
    there, here = (
        np.array([lcmt_panda_command.decode(message.data).joint_position for message in messages])
        for messages in (recorded, sent)
    )
    at = np.column_stack([np.interp(times[1], times[0], there[:, k]) for k in range(NUM_JOINTS)])
    return np.max(np.abs(at - here), axis=1)
