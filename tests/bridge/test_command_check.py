import numpy as np
import pytest
from drake import lcmt_panda_command, lcmt_panda_status

from pace_drake.bridge.command_check import CommandCheck, check_commands, command_differences
from pace_drake.bridge.lcm_log import LoggedMessage
from pace_drake.lcm.config import LcmConfig
from pace_drake.safety.joint_limits import JOINT_LIMITS

Q0 = np.array([0.0, -0.4, 0.0, -2.2, 0.0, 1.8, 0.8])
LIMITS = JOINT_LIMITS["fer"]
CONFIG = LcmConfig()


def status(time: float, position: np.ndarray = Q0) -> LoggedMessage:
    message = lcmt_panda_status()
    message.num_joints = 7
    for name in lcmt_panda_status.__slots__:
        if name.startswith("joint_"):
            setattr(message, name, [0.0] * 7)
    message.joint_position = position.tolist()
    return LoggedMessage(time, CONFIG.panda_status_channel, message.encode())


def command(time: float, position: np.ndarray, **changes: object) -> LoggedMessage:
    message = lcmt_panda_command()
    message.num_joint_position, message.joint_position = 7, position.tolist()
    message.control_mode_expected = lcmt_panda_status.CONTROL_MODE_POSITION
    for name, value in changes.items():
        setattr(message, name, value)
    return LoggedMessage(time, CONFIG.panda_command_channel, message.encode())


def stream(positions: np.ndarray, start: float = 1.0) -> list[LoggedMessage]:
    return [command(start + 0.005 * k, position) for k, position in enumerate(positions)]


def check(*messages: LoggedMessage) -> CommandCheck:
    return check_commands(messages, CONFIG)


def ramp(distance: float, duration: float) -> np.ndarray:
    """(n, 7) [rad] a minimum-jerk course of joint 2."""
    s = np.linspace(0.0, 1.0, round(duration / 0.005) + 1)
    return Q0 + np.outer(distance * s**3 * (10 - 15 * s + 6 * s**2), np.eye(7)[1])


def test_a_smooth_course_is_measured() -> None:
    found = check(status(0.9), *stream(ramp(0.5, 1.0)))
    assert found.kept
    assert (found.num_commands, found.num_streams) == (201, 1)
    assert found.velocity == pytest.approx(1.875 * 0.5 / 2.175, rel=1e-3)
    assert found.acceleration == pytest.approx(5.774 * 0.5 / 7.5, rel=1e-2)
    assert found.jerk == pytest.approx(60 * 0.5 / 3750, rel=0.05)
    assert found.position == pytest.approx(np.min([Q0 - LIMITS.lower, LIMITS.upper - Q0]), abs=1e-9)
    assert found.start == 0.0


@pytest.mark.parametrize(
    ("distance", "duration", "name"), [(0.5, 0.4, "velocity"), (0.1, 0.25, "acceleration"), (0.02, 0.05, "jerk")]
)
def test_a_course_beyond_a_limit_is_found(distance: float, duration: float, name: str) -> None:
    found = check(status(0.9), *stream(ramp(distance, duration)))
    assert getattr(found, name) > 1
    assert not found.kept


def test_a_position_beyond_its_limit_is_found() -> None:
    q = Q0.copy()
    q[6] = LIMITS.upper[6] + 0.001
    found = check(status(0.9, q), *stream(np.tile(q, (5, 1))))
    assert found.position == pytest.approx(-0.001)
    assert not found.kept


def test_a_start_away_from_the_arm_is_found() -> None:
    found = check(status(0.9, Q0 + 0.002), *stream(np.tile(Q0, (5, 1))))
    assert found.start == pytest.approx(0.002)
    assert not found.kept
    assert not check(*stream(np.tile(Q0, (5, 1)))).kept  # no status before


def test_a_gap_begins_a_new_stream_and_a_jump_within_one_is_none() -> None:
    first, second = stream(np.tile(Q0, (5, 1))), stream(np.tile(Q0 + 0.1, (5, 1)), start=1.5)
    found = check(status(0.9), *first, status(1.4, Q0 + 0.1), *second)
    assert (found.num_streams, found.velocity, found.kept) == (2, 0.0, True)
    found = check(status(0.9), *first, *stream(np.tile(Q0 + 0.1, (5, 1)), start=1.03))
    assert found.velocity > 1
    assert not found.kept


def test_a_burst_is_judged_by_the_command_period() -> None:
    messages = [LoggedMessage(1.0, m.channel, m.data) for m in stream(ramp(0.5, 1.0))]
    assert check(status(0.9), *messages).velocity < 1


@pytest.mark.parametrize(
    "changes",
    [
        {"control_mode_expected": 2},
        {"num_joint_velocity": 7, "joint_velocity": [0.0] * 7},
        {"num_joint_torque": 7, "joint_torque": [0.0] * 7},
        {"joint_position": [np.nan] * 7},
        {"num_joint_position": 6, "joint_position": [0.0] * 6},
    ],
)
def test_what_is_no_position_command_is_found(changes: dict[str, object]) -> None:
    found = check(status(0.9), command(1.0, Q0), command(1.005, Q0, **changes))
    assert found.wrong == ["command 2 at 1.005 s is no position command"]
    assert not found.kept


def test_tracking_is_the_distance_from_the_command_before() -> None:
    messages = [
        status(0.9),
        command(1.0, Q0),
        status(1.001, Q0 + 0.003),
        status(1.002, Q0 - 0.004),
        status(2.0, Q0 + 1),
    ]
    found = check(*messages)
    assert found.tracking == pytest.approx(0.004)
    assert found.tracking_rms == pytest.approx(np.sqrt((0.003**2 + 0.004**2) / 2))


def test_status_that_cannot_be_used_is_passed_over() -> None:
    bad = LoggedMessage(0.95, CONFIG.panda_status_channel, b"nonsense")
    assert check(status(0.9), bad, *stream(np.tile(Q0, (5, 1)))).kept


def test_a_log_without_commands_keeps_all_limits() -> None:
    found = check(status(0.9))
    assert found.kept
    assert found.to_json()["position"] is None


def test_commands_are_compared_at_their_times() -> None:
    recorded = [command(1.0, Q0), command(1.1, Q0 + 0.1)]
    sent = [command(1.0, Q0), command(1.05, Q0 + 0.05), command(1.1, Q0 + 0.13)]
    np.testing.assert_allclose(command_differences(recorded, sent), [0.0, 0.0, 0.03], atol=1e-9)
