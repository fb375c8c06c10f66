"""OperatorInbox: which buttons have been pressed, and how often."""

from collections import deque

from pace_drake.lcm.link import Lcm
from pace_drake.lcm.types import lcmt_pace_operator

#: Messages that are remembered, to know duplicates by.
_REMEMBERED = 100


class OperatorInbox:
    """Counts the presses of the person's and the operator's buttons; what cannot be used is counted and never raised.

    It is no ``Inbox``: every press counts, not the newest message, and no press is dropped for its stamp, as several
    senders with clocks of their own write here, and a stop must not be lost to another's clock. A duplicate is what
    equals one of the last 100 messages to the byte.

    Attributes:
        num_request, num_stop, num_ack: presses so far.
        stopped: whether the last of STOP and ACKNOWLEDGE was STOP.
        num_old: duplicates dropped.
        num_bad: messages dropped because they cannot be used.
        last_bad: what was wrong with the last of those; empty if nothing was.

    Args:
        lcm: where the channel is.
        channel: its name.
    """

    def __init__(self, lcm: Lcm, channel: str) -> None:
        self.num_request = self.num_stop = self.num_ack = 0
        self.stopped = False
        self.num_old = self.num_bad = 0
        self.last_bad = ""
        self._seen: deque[bytes] = deque(maxlen=_REMEMBERED)
        lcm.Subscribe(channel, self.take)

    def take(self, data: bytes) -> None:
        """Takes in the bytes of a message."""
        try:
            event = lcmt_pace_operator.decode(data).event
        # What lcm-gen writes raises whatever struct, slicing and codecs raise on bytes from outside.
        except Exception as error:
            self._refuse(f"cannot be decoded as lcmt_pace_operator ({type(error).__name__})")
            return
        if data in self._seen:
            self.num_old += 1
            return
        if event == lcmt_pace_operator.REQUEST:
            self.num_request += 1
        elif event == lcmt_pace_operator.STOP:
            self.num_stop += 1
            self.stopped = True
        elif event == lcmt_pace_operator.ACKNOWLEDGE:
            self.num_ack += 1
            self.stopped = False
        else:
            self._refuse(f"has no event {event}")
            return
        self._seen.append(data)

    def _refuse(self, what: str) -> None:
        self.num_bad += 1
        self.last_bad = what
