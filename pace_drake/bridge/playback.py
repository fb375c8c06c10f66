"""Playback: a recorded LCM log in place of the network, and its time in place of the clock."""

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable
from itertools import pairwise
from math import inf

from pace_drake.bridge.lcm_log import LoggedMessage

#: [s] between messages that were taken in at one look: reading one takes a tenth of that, and no status comes so soon.
_ONE_LOOK = 3e-4
#: Messages that came at one look, from which on they had been waiting for it: at 1 kHz, for as many milliseconds.
_WAITING = 8


class Playback:
    """Hands the messages of a log over as the network did; what is published goes into a list.

    It is an ``Lcm`` for a Session and, by ``clock``, its clock: time passes while one waits for a message, and nothing
    else takes any, except where the process that logged them did not look: many messages at once after a silence.

    Attributes:
        sent: what was published.

    Args:
        messages: of the log.
        omitted: channels that are not handed over, such as the one that is played anew.
    """

    def __init__(self, messages: Iterable[LoggedMessage], omitted: Collection[str] = ()) -> None:
        self._messages = [m for m in messages if m.channel not in omitted]
        self._place = 0
        self._time = self._messages[0].time if self._messages else 0.0
        self._handlers: dict[str, list[Callable[[bytes], None]]] = defaultdict(list)
        self.sent: list[LoggedMessage] = []

    @property
    def over(self) -> bool:
        """Whether all messages have been handed over."""
        return self._place == len(self._messages)

    def clock(self) -> float:
        """[s since the Unix epoch] in the log."""
        return self._time

    def Publish(self, channel: str, buffer: bytes) -> None:
        """See ``Lcm``."""
        self.sent.append(LoggedMessage(self._time, channel, buffer))

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> None:
        """See ``Lcm``."""
        self._handlers[channel].append(handler)

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """See ``Lcm``."""
        deadline, count = inf if self._were_waiting() else self._time + 1e-3 * timeout_millis, 0
        while not self.over and self._messages[self._place].time <= (self._time + _ONE_LOOK if count else deadline):
            message = self._messages[self._place]
            self._place += 1
            self._time = max(self._time, message.time)
            for handler in self._handlers[message.channel]:
                handler(message.data)
                count += 1
        if not count:
            self._time = self._time if deadline == inf else deadline
        return count

    def _were_waiting(self) -> bool:
        """Whether the next messages had come while the process that logged them was not looking."""
        times = [message.time for message in self._messages[self._place : self._place + _WAITING]]
        return len(times) == _WAITING and all(b - a <= _ONE_LOOK for a, b in pairwise(times))
