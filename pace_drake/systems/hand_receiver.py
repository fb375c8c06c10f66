"""HandReceiver: where a real person's hand is, from a tracker, over LCM."""

from math import dist, inf, isfinite, nan
from typing import Any

from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.lcm.inbox import Inbox
from pace_drake.lcm.link import Lcm
from pace_drake.lcm.types import lcmt_pace_hand
from pace_drake.ports import declare_output

#: [m] from the world's origin; a hand that is farther away has been measured in other units.
FARTHEST = 10.0
#: Samples by which one may come too late to be one out of order; beyond, the tracker has been started anew.
_REORDERED = 100

_POSITION, _ARRIVAL, _COUNT = slice(0, 3), 3, 4


def wrong_with(sample: lcmt_pace_hand) -> str:
    """What makes a sample useless; empty if nothing does."""
    if not all(isfinite(value) for value in sample.p_WH):
        return f"p_WH {sample.p_WH} is not finite"
    if dist(sample.p_WH, (0.0, 0.0, 0.0)) > FARTHEST:
        return f"p_WH {sample.p_WH} [m] is farther than {FARTHEST:g} m from the origin; are these other units?"
    return ""


class HandReceiver(LeafSystem):
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
        [p_WH (3) [m], time of arrival [s], samples].

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
        super().__init__()
        self.set_name("hand_receiver")
        self.inbox = Inbox(
            lcm,
            channel,
            lcmt_pace_hand,
            stamp=lambda sample: sample.sequence,
            restart=_REORDERED,
            check=wrong_with,
        )
        initial: Any = [nan, nan, nan, -inf, 0.0]
        self.DeclareDiscreteState(initial)
        state = {self.xd_ticket()}
        declare_output(self, "p_WH", lambda context: self._x(context)[_POSITION], state, size=3)
        declare_output(
            self,
            "hand_age",
            lambda context: context.get_time() - self._x(context)[_ARRIVAL],
            state | {self.time_ticket()},
        )
        declare_output(self, "num_samples", lambda context: self._x(context)[_COUNT], state)
        self.DeclareInitializationDiscreteUpdateEvent(self._update)
        self.DeclarePerStepDiscreteUpdateEvent(self._update)

    @staticmethod
    def _x(context: Context) -> Any:
        return context.get_discrete_state_vector().value()

    def _update(self, context: Context, values: DiscreteValues) -> None:
        inbox = self.inbox
        if inbox.num_good != self._x(context)[_COUNT]:
            values.set_value([*inbox.newest.p_WH, context.get_time(), float(inbox.num_good)])
