"""The status message of the arm, and when it is due."""

from drake import lcmt_panda_status

from pace_drake.driver.robot import RobotMode, RobotState


def make_status(state: RobotState, utime: int, *, controlled: bool) -> lcmt_panda_status:
    """Returns the status message.

    Args:
        state: of the robot.
        utime: wall clock [us].
        controlled: whether the driver commands the robot now, in position mode.
    """
    message = lcmt_panda_status()
    message.utime = utime
    message.num_joints = 7
    message.joint_position, message.joint_velocity, message.joint_torque = state.q, state.dq, state.tau_J
    message.joint_position_desired, message.joint_velocity_desired = state.q_d, state.dq_d
    message.joint_acceleration_desired, message.joint_torque_desired = state.ddq_d, state.tau_J_d
    message.joint_torque_external = state.tau_ext
    message.control_command_success_rate = state.success_rate
    message.robot_mode = int(state.mode)
    message.robot_utime = round(1e6 * state.time)
    moving = controlled and state.mode == RobotMode.MOVE
    message.control_mode = lcmt_panda_status.CONTROL_MODE_POSITION if moving else 0
    return message


class Pace:
    """Says when something that is done at a rate is due; what was missed is not made up for."""

    def __init__(self, rate: float) -> None:
        """Sets the rate [Hz]."""
        self._period, self._next = 1.0 / rate, 0.0

    def due(self, now: float) -> bool:
        """Returns whether it is due now [s], at most once a period."""
        if now < self._next:
            return False
        # Of a grid, so that the mean rate is kept though cycles seldom fall on it.
        self._next = max(self._next + self._period, now + 0.5 * self._period)
        return True
