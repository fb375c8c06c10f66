"""How the driver behaves: rates, what it accepts, and what it does after a reflex."""

import dataclasses as dc
import math

from pace_drake.errors import require


@dc.dataclass(frozen=True)
class DriverConfig:
    """Settings of the driver; the channels are those of ``pace_drake.lcm.config.LcmConfig``."""

    status_rate: float = 500.0  # [Hz] status messages, 200 to 1000
    expiry: float = 0.1  # [s] a command is dropped when its stamp is further than this from the clock, either way
    start_tolerance: float = 0.05  # [rad] up to 0.2; per joint, largest |commanded - measured| of the first command
    silence: float = 0.5  # [s] after this long without a command the next one is a first command again
    recover: bool = True  # False: after a reflex, wait until somebody else has recovered the robot
    recover_delay: float = 1.0  # [s] from the reflex to the attempt to recover; doubles up to 30 s when it fails

    def __post_init__(self) -> None:
        for field in dc.fields(self):
            value = getattr(self, field.name)
            require(math.isfinite(value), f"driver.{field.name}", f"must be a finite number, not {value}")
            require(value > 0 or field.name == "recover", f"driver.{field.name}", f"must be positive, not {value}")
        require(200 <= self.status_rate <= 1000, "driver.status_rate", "must be from 200 to 1000 Hz")
        # Beyond, the arm would set off from where the commands are not.
        require(
            self.start_tolerance <= 0.2,
            "driver.start_tolerance",
            f"must be at most 0.2 rad, not {self.start_tolerance:g}",
        )
