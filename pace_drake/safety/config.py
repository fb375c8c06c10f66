"""How the robot keeps its distance from the person's hand: settings of speed and separation monitoring."""

from dataclasses import dataclass
from math import inf

from pace_drake.errors import require


@dataclass(kw_only=True)
class SafetyConfig:
    """Speed and separation monitoring (docs/safety.md). The defaults are those of ISO/TS 15066 where it gives any."""

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
    """[s] between two looks."""

    def validate(self, name: str = "safety") -> None:
        """Raises InputError that names the field if a value cannot be used."""
        for field in ("human_speed", "margin", "contact_speed", "stop_distance"):
            value = getattr(self, field)
            require(0 <= value < inf, f"{name}.{field}", f"must be >= 0, is {value}")
        for field in ("reaction_time", "hand_timeout", "period"):
            value = getattr(self, field)
            require(0 < value < inf, f"{name}.{field}", f"must be > 0 [s], is {value}")
        require(
            self.period < self.reaction_time,
            f"{name}.period",
            f"must be shorter than {name}.reaction_time, {self.reaction_time} [s], is {self.period}",
        )
