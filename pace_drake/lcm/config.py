"""Where the LCM channels are, how often the robot's are written, and what counts as trouble."""

from dataclasses import dataclass, fields
from math import isfinite

from pace_drake.errors import require
from pace_drake.safety.joint_limits import JOINT_LIMITS


@dataclass
class LcmConfig:
    """LCM settings of the hardware station and the person; readable by ``pydrake.common.yaml.yaml_load_typed``.

    The defaults are the contract of the TRI driver ``drake-franka-driver``, with LCM off (docs/lcm.md).
    """

    url: str = "memq://null"
    """LCM URL; memq://null: no message leaves this process."""
    robot: str = "fer"
    """Whose joint limits are kept: ``fer`` (the Panda) or ``fr3``."""
    panda_status_channel: str = "PANDA_STATUS"
    """lcmt_panda_status, from the driver."""
    panda_command_channel: str = "PANDA_COMMAND"
    """lcmt_panda_command, to the driver."""
    hand_status_channel: str = "PANDA_HAND_STATUS"
    """lcmt_schunk_wsg_status, from the driver."""
    hand_command_channel: str = "PANDA_HAND_COMMAND"
    """lcmt_schunk_wsg_command, to the driver."""
    person_hand_channel: str = "PACE_HAND"
    """lcmt_pace_hand, from the tracker of the person's hand."""
    operator_channel: str = "PACE_OPERATOR"
    """lcmt_pace_operator, from the buttons of the person and the operator."""
    decision_channel: str = "PACE_DECISION"
    """lcmt_pace_decision, from this project."""
    state_channel: str = "PACE_STATE"
    """lcmt_pace_state, from this project."""
    command_rate: float = 200.0
    """[Hz] below 200 the step-hold shows as tracking error; above 300 braking would exceed the jerk limits."""
    hand_command_rate: float = 10.0
    """[Hz] rate of the hand driver's loop."""
    status_timeout: float = 0.05
    """[s] an older status is a fault, and silences the commands."""
    hand_status_timeout: float = 0.5
    """[s] no command is sent to the gripper on an older status of it, which comes at 10 Hz."""
    min_success_rate: float = 0.8
    """[-] share of the last hundred commands that the robot took in time (libfranka's), below which it stops."""
    max_clock_skew: float = 0.08
    """[s] between the driver's clock and ours; the driver drops what is 0.1 s old."""
    max_tracking_error: float = 0.15
    """[rad] between a joint's commanded and measured position."""
    limit_margin: float = 0.02
    """[rad] kept from the position limits."""
    max_stall: float = 0.05
    """[s] for which this process may fall behind while the arm moves."""
    start_tolerance: float = 0.01
    """[rad] within which a held position is where the arm is."""
    join_speed: float = 0.1
    """[-] share of the velocity limits with which the arm is led to its path."""
    join_range: float = 2.0
    """[rad] largest way of a joint to its path."""
    gripper_force: float = 40.0
    """[N] grasp force when closing."""

    @property
    def synthetic_hand_channel(self) -> str:
        """Where `pace hand` says, as text and beside each sample, whose hand it plays if that is SYNTHETIC."""
        return f"{self.person_hand_channel}_SYNTHETIC"

    def validate(self) -> None:
        """Checks every field; ``yaml_load_typed`` sets them after construction, so a constructor could not.

        Raises:
            InputError: names the first field that cannot be used.
        """
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, float):
                require(isfinite(value) and value > 0.0, f"lcm.{f.name}", f"must be a positive number, is {value}")
            else:
                require(bool(value), f"lcm.{f.name}", "is empty: name it, or leave it out for the default")
        require(self.robot in JOINT_LIMITS, "lcm.robot", f"must be {' or '.join(JOINT_LIMITS)}, is {self.robot!r}")
        require(self.command_rate <= 300.0, "lcm.command_rate", f"must be at most 300 [Hz], is {self.command_rate}")
        for name in ("min_success_rate", "join_speed"):
            require(getattr(self, name) <= 1.0, f"lcm.{name}", f"must be at most 1, is {getattr(self, name)}")
