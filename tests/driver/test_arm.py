import numpy as np
import pytest
from drake import lcmt_panda_status

from pace_drake.driver.config import DriverConfig
from pace_drake.driver.robot import ConnectionLost, MotionAborted, RobotMode
from pace_drake.errors import InputError
from pace_drake.safety.joint_limits import JOINT_LIMITS
from tests.driver.fake import START, Rig

pytest.importorskip("ruckig", reason="needs the extra 'driver'")

from tests.driver.test_smoother import check_limits

FR3 = JOINT_LIMITS["fr3"]

MOVE, REFLEX, IDLE = RobotMode.MOVE, RobotMode.REFLEX, RobotMode.IDLE

CONNECTED = "connected to the robot; holding its position until a command comes"


def test_it_holds_until_commands_come_follows_them_and_holds_when_they_stop():
    rig = Rig()
    goal = START + 0.2

    def script(cycle: int) -> None:
        if 1000 <= cycle <= 3000 and cycle % 5 == 0:
            rig.send(START + (goal - START) * (cycle - 1000) / 2000)

    rig.run(script, 5000)
    np.testing.assert_allclose(rig.robot.sent[990], START, atol=1e-9)
    np.testing.assert_allclose(rig.robot.sent[4000:], np.tile(goal, (len(rig.robot.sent) - 4000, 1)), atol=1e-6)
    assert rig.reports == [CONNECTED]
    assert rig.robot.calls == ["connect", "control", "close"]


def test_status_says_what_the_robot_says():
    rig = Rig(DriverConfig(status_rate=200.0))
    rig.run(lambda cycle: None, 1000)
    assert len(rig.statuses) == pytest.approx(200, abs=5)
    status = rig.statuses[-1]
    assert (status.robot_mode, status.control_mode) == (MOVE, lcmt_panda_status.CONTROL_MODE_POSITION)
    assert status.control_command_success_rate == 0.9
    # libfranka's sign, the opposite of Drake's.
    assert status.joint_torque_external == pytest.approx([0.1 * joint for joint in range(7)])
    assert status.num_joints == 7
    assert rig.statuses[0].robot_utime == 1000
    assert np.ptp([s.utime - s.robot_utime for s in rig.statuses]) == 0
    # The first one is of a robot that is not controlled yet.
    assert (rig.statuses[0].robot_mode, rig.statuses[0].control_mode) == (IDLE, 0)


def test_after_a_reflex_it_reports_recovers_and_moves_on_a_new_near_command_only():
    rig = Rig()
    where = {}

    def script(cycle: int) -> None:
        if cycle == 500:
            rig.robot.reflex(MotionAborted("cartesian_reflex"))
        if cycle % 5 == 0 and cycle < 3000:
            rig.send(START + 0.2)  # a sender that has not noticed anything
        if cycle % 5 == 0 and cycle >= 3000:
            rig.send(START + 0.02 * min(1.0, (cycle - 3000) / 500))
        if cycle == 2990:
            where["before"] = rig.robot.q.copy()

    rig.run(script, 5000)
    assert rig.robot.calls == ["connect", "control", "recover", "control", "close"]
    assert rig.modes() == [IDLE, MOVE, REFLEX, MOVE]
    np.testing.assert_allclose(where["before"], START, atol=1e-9)
    np.testing.assert_allclose(rig.robot.q, START + 0.02, atol=1e-6)
    # Status went on through the reflex: a second of it at 500 Hz.
    assert sum(status.robot_mode == REFLEX for status in rig.statuses) == pytest.approx(500, abs=10)
    text = "\n".join(rig.reports)
    assert "the motion was aborted: cartesian_reflex" in text
    assert "the robot is in reflex; recovery in 1 s" in text
    assert "recovered; holding the measured position" in text
    assert "the last one: the robot is not under control" in text
    assert "first command is 0.200 rad from the measured position" in text


def test_recovery_can_be_left_to_others():
    rig = Rig(DriverConfig(recover=False))

    def script(cycle: int) -> None:
        if cycle == 500:
            rig.robot.reflex(MotionAborted("joint_reflex"))
        if cycle == 9000:
            rig.robot.recover()

    rig.run(script, 10000)
    assert rig.robot.calls == ["connect", "control", "recover", "control", "close"]
    assert sum(status.robot_mode == REFLEX for status in rig.statuses) > 4000


def test_recovery_that_fails_is_tried_again_later():
    rig = Rig()
    times: list[float] = []

    def recover() -> None:
        times.append(rig.robot.time)
        if len(times) < 4:
            raise MotionAborted("not now")

        rig.robot.mode = IDLE

    rig.robot.recover = recover  # type: ignore[method-assign]

    def script(cycle: int) -> None:
        if cycle == 500:
            rig.robot.reflex(MotionAborted("joint_reflex"))

    rig.run(script, 20000)
    assert np.diff(times) == pytest.approx([2.0, 4.0, 8.0], abs=0.01)
    assert rig.reports.count("recovery failed: not now") == 3
    assert rig.robot.calls == ["connect", "control", "control", "close"]


def test_a_motion_that_is_aborted_at_once_is_not_begun_a_thousand_times():
    rig = Rig()

    def script(cycle: int) -> None:
        if rig.robot.mode == MOVE:
            rig.robot.mode = IDLE
            raise MotionAborted("refused")

    rig.run(script, 5000)
    assert 3 <= rig.robot.calls.count("control") <= 6


def test_user_stop_is_waited_for():
    rig = Rig()

    def script(cycle: int) -> None:
        if cycle == 1:
            rig.robot.mode = RobotMode.USER_STOPPED
        if cycle == 2000:
            rig.robot.mode = IDLE

    rig.run(script, 3000)
    assert rig.modes() == [RobotMode.USER_STOPPED, MOVE]
    assert rig.reports == [CONNECTED, "the robot is in mode USER_STOPPED; waiting until it is IDLE"]


def test_a_lost_connection_is_made_again_with_longer_and_longer_pauses():
    rig = Rig()
    times: list[float] = []

    def connect() -> None:
        times.append(rig.robot.time)
        if 1 < len(times) < 5:
            raise ConnectionLost("timeout")

    rig.robot.connect = connect  # type: ignore[method-assign]

    def script(cycle: int) -> None:
        if cycle == 500:
            rig.robot.mode = IDLE
            raise ConnectionLost("timeout")
        if rig.robot.time > 16 and cycle % 5 == 0:
            rig.send(START + 0.5)

    rig.run(script, 17000)
    assert np.diff(times) == pytest.approx([1.5, 2.0, 4.0, 8.0], abs=0.05)
    assert "no connection to the robot (timeout); next attempt in 1 s" in rig.reports
    assert "connected to the robot again" in rig.reports
    np.testing.assert_allclose(rig.robot.q, START, atol=1e-9)
    assert "first command" in rig.reports[-1]
    # No status while nothing is known of the robot.
    assert np.diff([status.utime for status in rig.statuses]).max() > 1e6


def test_a_first_connection_that_fails_is_an_error():
    rig = Rig()
    rig.robot.connect = lambda: (_ for _ in ()).throw(ConnectionLost("refused"))  # type: ignore[method-assign]
    with pytest.raises(ConnectionLost):
        rig.run(lambda cycle: None, 10)


def test_it_stops_within_the_limits():
    rig = Rig()

    def script(cycle: int) -> None:
        if cycle >= 500 and cycle % 5 == 0:
            rig.send(START + 5e-4 * (cycle - 500))  # 0.5 rad/s

    rig.run(script, 1500)
    path = np.array(rig.robot.sent)
    check_limits(path, FR3)
    assert np.abs(path[-1] - path[-2]).max() < 1e-6
    # It was moving, brakes at once from 0.5 rad/s at 10 rad/s^2, and does not go back to what was commanded.
    told = 1500 - 2
    assert path[told][0] - path[told - 1][0] == pytest.approx(5e-4, rel=0.1)
    assert 0.010 < path[-1][0] - path[told][0] < 0.025
    assert rig.robot.calls[-1] == "close"


def test_dropped_commands_are_reported_once_a_second_in_one_line():
    rig = Rig()

    def script(cycle: int) -> None:
        if cycle >= 100 and cycle % 5 == 0:
            rig.send(START, age=0.2)

    rig.run(script, 3100)
    assert 4 <= len(rig.reports) <= 5
    assert rig.reports[2] == "dropped 180 commands, the last one: stamped 0.200 s in the past"


@pytest.mark.parametrize("field", ["status_rate", "expiry", "start_tolerance", "silence", "recover_delay"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_config_is_checked(field, value):
    with pytest.raises(InputError, match=f"driver.{field}"):
        DriverConfig(**{field: value})


def test_status_rate_has_bounds():
    for rate in (199.0, 1001.0):
        with pytest.raises(InputError, match="200 to 1000"):
            DriverConfig(status_rate=rate)
