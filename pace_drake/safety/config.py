"""How the robot keeps its distance from the person's hand, and how it knows what is in its gripper: settings."""

from dataclasses import dataclass
from math import inf

from pace_drake.errors import require


@dataclass(kw_only=True)
class SafetyConfig:
    """Speed and separation monitoring, and the grasp check (docs/safety.md).

    The defaults are those of ISO/TS 15066 where it gives any.
    """

    enabled: bool = True
    """Whether the station's arm is monitored; the task level has no arm."""
    human_speed: float = 1.6
    """[m/s] at which a hand may come nearer; 1.6 where it is not measured."""
    reaction_time: float = 0.1
    """[s] from a hand's motion to the start of the robot's slowing down: tracker, arm's lag; the monitor adds its own
    period to it."""
    margin: float = 0.11
    """[m] C + Z_d + Z_r: how far a hand intrudes before it is seen, and the uncertainties of both positions."""
    contact_speed: float = 0.65
    """[m/s] at which the robot may close in on a hand inside the protective distance (power and force limiting); 0:
    it may not (strict monitoring). 0.65 pushes a hand with 133 N, of 140 N quasi-static and 280 N transient that it
    bears (docs/safety.md)."""
    stop_distance: float = 0.05
    """[m] short of a hand that keeps still the robot stops, but in joint actions, where contact is intended."""
    hand_timeout: float = 0.2
    """[s] an older hand signal stops the robot until the operator acknowledges."""
    period: float = 0.01
    """[s] between two looks, also at the gripper."""
    grasp_check: bool = True
    """Whether a gripper that does not hold what it has fetched is a fault; switch it off where the gripper is one that
    is only simulated on hardware, as by `pace driver --hand simulated`."""
    grasp_tolerance: float = 0.005
    """[m] by which the measured width of the closed gripper may differ from that of what it holds; less than
    ``workcell.gripper_squeeze``."""
    grasp_settle_time: float = 1.0
    """[s] after the commanded width has closed, for fingers to have closed as well."""

    def validate(self, name: str = "safety") -> None:
        """Raises InputError that names the field if a value cannot be used."""
        for field in ("human_speed", "margin", "contact_speed", "stop_distance"):
            value = getattr(self, field)
            require(0 <= value < inf, f"{name}.{field}", f"must be >= 0, is {value}")
        for field in ("reaction_time", "hand_timeout", "period", "grasp_settle_time"):
            value = getattr(self, field)
            require(0 < value < inf, f"{name}.{field}", f"must be > 0 [s], is {value}")
        require(
            0 < self.grasp_tolerance < inf,
            f"{name}.grasp_tolerance",
            f"must be > 0 [m], is {self.grasp_tolerance}",
        )
        require(
            self.period < self.reaction_time,
            f"{name}.period",
            f"must be shorter than {name}.reaction_time, {self.reaction_time} [s], is {self.period}",
        )
