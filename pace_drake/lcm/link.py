"""LCM as the hardware level needs it: every message of a channel, one's own left out, and a tap for a log."""

from collections import defaultdict, deque
from collections.abc import Callable
from functools import partial
from typing import Protocol

#: Messages of one channel that may wait until the next look: a fifth of a second of status at 1 kHz.
QUEUE_CAPACITY = 200
#: Messages of one's own on one channel that are remembered: five seconds of commands.
_ECHOES = 1000


class Lcm(Protocol):
    """What systems need of LCM; ``pydrake.lcm.DrakeLcm`` (``memq://``), LcmNetwork and LcmLink have it."""

    def Publish(self, channel: str, buffer: bytes) -> None:
        """Sends the bytes of a message."""

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> object:
        """Calls ``handler`` with the bytes of each message, from within HandleSubscriptions."""

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """Waits for a message, hands over all that have come, and returns how many."""


class LcmNetwork:
    """``lcm.LCM`` with the methods of ``DrakeLcmInterface``; ``pace_drake.lcm.url.open_lcm`` makes it.

    DrakeLcm on a network keeps one message per channel between two looks, the oldest; this hands over every one.

    Args:
        url: LCM URL, after the preflight.
    """

    def __init__(self, url: str) -> None:
        from lcm import LCM

        self._lcm = LCM(url)

    def Publish(self, channel: str, buffer: bytes) -> None:
        """See ``Lcm``."""
        self._lcm.publish(channel, buffer)

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> None:
        """See ``Lcm``."""
        self._lcm.subscribe(channel, lambda _, data: handler(data)).set_queue_capacity(QUEUE_CAPACITY)

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """See ``Lcm``."""
        try:
            count = self._lcm.handle_timeout(timeout_millis)
        except OSError:
            # A signal, such as Ctrl-C, ends the wait. If it is the network that failed, the next call raises as well.
            count = 0
        while self._lcm.handle_timeout(0):
            count += 1
        return count


class LcmLink:
    """Another LCM from the point of view of one participant: it does not hear itself, and all it does can be logged.

    What comes on a channel on which one also sends is therefore somebody else's.

    Args:
        lcm: the LCM behind it.
        tap: called with channel and bytes of every message, received or sent, such as ``LcmLog.write``.
    """

    def __init__(self, lcm: Lcm, tap: Callable[[str, bytes], None] = lambda channel, data: None) -> None:
        self._lcm, self._tap = lcm, tap
        self._sent: dict[str, deque[bytes]] = defaultdict(partial(deque, maxlen=_ECHOES))

    def Publish(self, channel: str, buffer: bytes) -> None:
        """See ``Lcm``."""
        self._sent[channel].append(buffer)
        self._lcm.Publish(channel, buffer)
        self._tap(channel, buffer)

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> None:
        """See ``Lcm``; with a tap, once for each channel, or its messages are logged as often."""

        def handle(data: bytes) -> None:
            if data not in self._sent[channel]:
                self._tap(channel, data)
                handler(data)

        self._lcm.Subscribe(channel, handle)

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        """See ``Lcm``."""
        return self._lcm.HandleSubscriptions(timeout_millis)
