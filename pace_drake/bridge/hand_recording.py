"""HandRecording: what a tracker sends while a person shows an action becomes a demonstration."""

from collections.abc import Iterable

import numpy as np

from pace_drake.bridge.lcm_log import LoggedMessage
from pace_drake.demos.model import Demonstration, interpolate
from pace_drake.errors import InputError, require
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.inbox import Sieve
from pace_drake.lcm.types import lcmt_pace_hand
from pace_drake.systems.hand_receiver import HAND


class HandRecording:
    """Takes the samples of one action (``lcmt_pace_hand``) as they come.

    Samples that cannot be used, and those that come after a later one, are left out as the diagram leaves them out;
    the gaps that they leave are judged in the end. Times are the tracker's, as arrivals are those of the network, too.

    Attributes:
        synthetic: whether the hand is known not to be a person's.
    """

    def __init__(self) -> None:
        self.synthetic = False
        self._times: list[float] = []
        self._p_WH: list[tuple[float, ...]] = []
        self._sieve = Sieve(lcmt_pace_hand, **HAND)

    @property
    def num_samples(self) -> int:
        """Good samples so far."""
        return len(self._times)

    def take(self, data: bytes) -> None:
        """Takes the bytes of a message; never raises."""
        if self._sieve.take(data):
            sample = self._sieve.newest
            self._times.append(1e-6 * sample.utime)
            self._p_WH.append(tuple(sample.p_WH))

    def demonstration(self, action: str, subject: str, trial: str, period: float, max_gap: float) -> Demonstration:
        """What was shown, at a uniform period: what the diagram would have sampled of it.

        Args:
            action, subject, trial: its labels.
            period: [s] between its samples.
            max_gap: [s] without a sample that is refused.

        Raises:
            InputError: no or too few samples, a gap, or a clock that does not run forwards; one line.
        """
        name = f"{action}/{subject}/{trial}"
        sieve = self._sieve
        bad = f"; {sieve.num_bad} that cannot be used, the last: {sieve.last_bad}" if sieve.num_bad else ""
        require(len(self._times) > 1, name, f"only {len(self._times)} usable samples of the hand{bad}")
        times = np.array(self._times) - self._times[0]
        steps = np.diff(times)
        if (steps <= 0.0).any():
            k = int(np.argmax(steps <= 0.0))
            raise InputError(
                f"{name}: the tracker's clock (utime) goes from {times[k]:.6f} to {times[k + 1]:.6f} s: it must stamp"
                " each sample, later than the one before"
            )
        k = int(np.argmax(steps))
        if steps[k] > max_gap:
            raise InputError(
                f"{name}: no usable sample for {steps[k]:.2f} s, from {times[k]:.2f} s on, {max_gap:g} at most{bad};"
                " look after the tracker and show it again, or cut there"
            )
        uniform = np.arange(int(times[-1] / period + 1e-9) + 1) * period
        require(len(uniform) > 1, name, f"takes {times[-1]:.2f} s, which is less than a period of {period:g} s")
        p_WH = interpolate(uniform, times, np.array(self._p_WH))
        return Demonstration(action, subject, trial, period, p_WH, self.synthetic)


def recording_of(
    messages: Iterable[LoggedMessage], config: LcmConfig, start: float = 0.0, end: float = np.inf
) -> HandRecording:
    """The hand in a part of a log.

    Args:
        messages: of the log, the first one included: times are relative to it.
        config: names the channel.
        start, end: [s] since the first message; both inclusive.

    Raises:
        InputError: no hand is in the log, or none in this part of it.
    """
    recording = HandRecording()
    first: float | None = None
    heard: dict[str, None] = {}
    seen: list[float] = []
    for message in messages:
        first = message.time if first is None else first
        time = message.time - first
        heard[message.channel] = None
        if message.channel == config.person_hand_channel:
            seen.append(time)
            if start <= time <= end:
                recording.take(message.data)
        elif message.channel == config.synthetic_hand_channel and start <= time <= end:
            recording.synthetic = True
    if not seen:
        raise InputError(
            f"no {config.person_hand_channel} in it, but {', '.join(sorted(heard)) or 'nothing'}; name the tracker's"
            " with --channel"
        )
    if not any(start <= time <= end for time in seen):
        raise InputError(
            f"no {config.person_hand_channel} from {start:g} to {end:g} s; its messages lie from {min(seen):.2f} to"
            f" {max(seen):.2f} s"
        )
    return recording
