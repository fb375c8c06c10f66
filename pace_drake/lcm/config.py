"""Where the LCM channels are, how often the robot's are written, and what counts as fresh."""

import dataclasses as dc
import math

from pace_drake.errors import InputError


@dc.dataclass
class LcmConfig:
    """LCM settings of the hardware station and the person; readable by ``pydrake.common.yaml.yaml_load_typed``.

    The defaults are the contract of the TRI driver ``drake-franka-driver``, with LCM off (docs/lcm.md).
    """

    url: str = "memq://null"  # LCM URL; memq://null: no message leaves this process
    panda_status_channel: str = "PANDA_STATUS"  # lcmt_panda_status, from the driver
    panda_command_channel: str = "PANDA_COMMAND"  # lcmt_panda_command, to the driver
    hand_status_channel: str = "PANDA_HAND_STATUS"  # lcmt_schunk_wsg_status, from the driver
    hand_command_channel: str = "PANDA_HAND_COMMAND"  # lcmt_schunk_wsg_command, to the driver
    person_hand_channel: str = "PACE_HAND"  # lcmt_pace_hand, from the tracker of the person's hand
    operator_channel: str = "PACE_OPERATOR"  # lcmt_pace_operator, from the buttons of the person and the operator
    decision_channel: str = "PACE_DECISION"  # lcmt_pace_decision, from this project
    state_channel: str = "PACE_STATE"  # lcmt_pace_state, from this project
    command_rate: float = 200.0  # [Hz] below 200 the step-hold of the driver shows as tracking error
    hand_command_rate: float = 10.0  # [Hz] rate of the hand driver's loop
    status_timeout: float = 0.05  # [s] no arm command is sent on an older status
    hand_status_timeout: float = 0.5  # [s] the same for the hand, whose status comes at 10 Hz
    start_tolerance: float = 0.01  # [rad] per joint, largest |commanded - measured| at the first command
    gripper_force: float = 40.0  # [N] grasp force when closing

    def validate(self) -> None:
        """Checks every field; `yaml_load_typed` sets them after construction, so a constructor could not.

        Raises:
            InputError: names the first field that cannot be used.
        """
        for field in dc.fields(self):
            value = getattr(self, field.name)
            if field.type in (float, "float"):
                if not (math.isfinite(value) and value > 0.0):
                    raise InputError(f"lcm.{field.name} is {value}: it must be a positive number")
            elif not value:
                raise InputError(f"lcm.{field.name} is empty: name it, or leave it out for the default")
