"""PathClock: how far along its path a motion is, when its rate falls and rises."""

from math import inf, sqrt
from typing import NamedTuple


class PathClock(NamedTuple):
    """The scaled time in which a path is passed: its rate goes in a straight line from what it was to what is aimed at.

    An arm that follows it stays on its path and never jumps in velocity.
    """

    duration: float
    """[s] of the path, passed at rate 1."""
    since: float
    """[s] when the next three were so."""
    passed: float
    """[s] path time."""
    rate: float
    """[-] path time per time."""
    aim: float
    """[-] rate aimed at."""
    stop_time: float
    """[s] in which the rate falls from 1 to 0."""

    @property
    def ramp(self) -> float:
        """[s] from ``since`` until the rate is what is aimed at."""
        return abs(self.aim - self.rate) * self.stop_time

    def at(self, time: float) -> tuple[float, float]:
        """(path time [s], rate [-]) at ``time``; the path time stays at the end of the path."""
        since, ramp = time - self.since, self.ramp
        if since < ramp:
            rate = self.rate + (self.aim - self.rate) * since / ramp
            path = self.passed + (self.rate + rate) / 2 * since
        else:
            rate = self.aim
            path = self.passed + (self.rate + rate) / 2 * ramp + rate * (since - ramp)
        return min(path, self.duration), rate

    @property
    def end(self) -> float:
        """[s] when the path comes to its end; inf if it is held before."""
        left, ramp = self.duration - self.passed, self.ramp
        if left <= 0 and self.aim:
            return self.since
        in_ramp = (self.rate + self.aim) / 2 * ramp
        if left > in_ramp or ramp == 0:
            return self.since + (ramp + (left - in_ramp) / self.aim) if self.aim else inf
        slope = (self.aim - self.rate) / ramp
        return self.since + 2 * left / (self.rate + sqrt(self.rate**2 + 2 * slope * left))

    def led(self, time: float, aim: float) -> "PathClock":
        """The clock that from ``time`` on aims at another rate."""
        passed, rate = self.at(time)
        return self._replace(since=time, passed=passed, rate=rate, aim=aim)
