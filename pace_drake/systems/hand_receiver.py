"""HandReceiver: where a real person's hand is, from a tracker, over LCM."""

from math import dist, isfinite
from typing import Any

import numpy as np

from pace_drake.demos.model import FARTHEST
from pace_drake.lcm.inbox import Inbox
from pace_drake.lcm.inbox_receiver import COUNT, InboxReceiver
from pace_drake.lcm.link import Lcm
from pace_drake.lcm.types import lcmt_pace_hand

#: Samples by which one may come too late to be one out of order; beyond, the tracker has been started anew.
REORDERED = 100

_POSITION = slice(2, 5)


def wrong_with(sample: lcmt_pace_hand) -> str:
    """What makes a sample useless; empty if nothing does."""
    if not all(isfinite(value) for value in sample.p_WH):
        return f"p_WH {sample.p_WH} is not finite"
    if dist(sample.p_WH, (0.0, 0.0, 0.0)) > FARTHEST:
        return f"p_WH {sample.p_WH} [m] is farther than {FARTHEST:g} m from the origin; are these other units?"
    return ""


#: How samples are judged, for ``Sieve``.
HAND: dict[str, Any] = {"stamp": lambda sample: sample.sequence, "restart": REORDERED, "check": wrong_with}


class HandReceiver(InboxReceiver):
    """Takes in the samples of a hand tracker (``lcmt_pace_hand``).

    The sequence number of the samples decides their order: duplicates and samples that come after a later one are
    dropped. One that lies further back than 100 is that of a tracker that has been started anew.

    Outputs:
        p_WH (3) [m]: hand, of the newest good sample; NaN before the first.
        hand_age (1) [s]: context time since that sample arrived; infinite before the first. It grows when the tracker
            falls silent, and when it says the same again. It does not contain what passed before the arrival: the
            tracker's own delay and the network's (``SafetyConfig.reaction_time`` must cover them), nor does it notice
            a tracker that goes on to send new numbers with an old position. A sample is taken in at the time to which
            the diagram had been advanced when it came, so that the age is over-, never underestimated; except for one
            that was there before initialization, which counts as having come then.
        num_samples (1): good samples so far; several between two steps count, and the newest of them is put out.

    State:
        [samples, time of arrival [s], p_WH (3) [m]].

    Events:
        update: at initialization and at every step. Outputs depend on state and time only, so that all who read them
            at one instant agree.

    Attributes:
        inbox: counts what was dropped, and says why.

    Args:
        lcm: where the channel is.
        channel: its name.
    """

    def __init__(self, lcm: Lcm, channel: str = "PACE_HAND") -> None:
        inbox = Inbox(lcm, channel, lcmt_pace_hand, **HAND)
        super().__init__(inbox, np.full(3, np.nan), "hand_age")
        self.set_name("hand_receiver")
        self._declare("p_WH", _POSITION)
        self._declare("num_samples", slice(COUNT, COUNT + 1))

    def _take(self, x: np.ndarray, message: lcmt_pace_hand) -> None:
        x[_POSITION] = message.p_WH
