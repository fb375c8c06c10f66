"""OperatorReceiver: the buttons of a real person and of the operator, over LCM."""

from math import inf
from typing import Any

from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.lcm.link import Lcm
from pace_drake.lcm.operator_inbox import OperatorInbox
from pace_drake.ports import declare_output

#: [s] for which a stop is put out at least, though it be acknowledged at once: no reader looks less often.
STOP_HOLD = 0.1
#: [s] between an acknowledgement and the pulse that it gives, so that two in a row give two rising edges.
ACK_GAP = 0.05

_STOPPED, _STOP_TIME, _ACK_TIME, _BUTTON, _SEEN = 0, 1, 2, 3, slice(4, 7)


class OperatorReceiver(LeafSystem):
    """Takes in the presses of buttons (``lcmt_pace_operator``): of the person, who is done, and of the operator.

    Every press counts, whatever comes between two steps. It is no emergency stop: a message may be lost.

    Outputs:
        stop (1): 1 from a STOP until the next ACKNOWLEDGE, and for ``STOP_HOLD`` at least, so that one that is
            acknowledged at once is seen by all.
        ack (1): 1 for ``ack_hold`` after each ACKNOWLEDGE, beginning ``ACK_GAP`` after it, so that who looks for a
            level and who looks for an edge sees it.
        button (1): REQUESTs so far, since initialization.

    State:
        [whether stopped, time of the last STOP [s], time of the last ACKNOWLEDGE [s], REQUESTs, number of REQUEST,
        STOP, ACKNOWLEDGE taken in].

    Events:
        initialization: a STOP that has not been acknowledged yet counts; REQUESTs and ACKNOWLEDGEs from before do not.
        update: at every step. Outputs depend on state and time only, so that all who read them at one instant agree.

    Attributes:
        inbox: counts what was dropped, and says why.

    Args:
        lcm: where the channel is.
        channel: its name.
        ack_hold: [s] long enough for an arm that was stopped at the same time to come to rest.
    """

    def __init__(self, lcm: Lcm, channel: str = "PACE_OPERATOR", ack_hold: float = 0.5) -> None:
        super().__init__()
        self.set_name("operator_receiver")
        self.inbox = OperatorInbox(lcm, channel)
        self._ack_hold = ack_hold
        initial: Any = [0.0, -inf, -inf, 0.0, 0.0, 0.0, 0.0]
        self.DeclareDiscreteState(initial)
        now = {self.xd_ticket(), self.time_ticket()}
        declare_output(self, "stop", self._stop, now)
        declare_output(self, "ack", self._ack, now)
        declare_output(self, "button", lambda context: self._x(context)[_BUTTON], {self.xd_ticket()})
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)
        self.DeclarePerStepDiscreteUpdateEvent(self._update)

    @staticmethod
    def _x(context: Context) -> Any:
        return context.get_discrete_state_vector().value()

    def _stop(self, context: Context) -> float:
        x = self._x(context)
        return float(x[_STOPPED] or context.get_time() - x[_STOP_TIME] < STOP_HOLD)

    def _ack(self, context: Context) -> float:
        return float(0.0 <= context.get_time() - self._x(context)[_ACK_TIME] - ACK_GAP < self._ack_hold)

    def _counts(self) -> tuple[int, int, int]:
        return self.inbox.num_request, self.inbox.num_stop, self.inbox.num_ack

    def _initialize(self, context: Context, values: DiscreteValues) -> None:
        x: Any = values.get_mutable_value(0)
        x[_STOPPED], x[_SEEN] = self.inbox.stopped, self._counts()

    def _update(self, context: Context, values: DiscreteValues) -> None:
        x: Any = values.get_mutable_value(0)
        requests, stops, acks = self._counts() - x[_SEEN]
        x[_SEEN] = self._counts()
        x[_BUTTON] += requests
        x[_STOPPED] = self.inbox.stopped
        if stops:
            x[_STOP_TIME] = context.get_time()
        if acks:
            x[_ACK_TIME] = context.get_time()
