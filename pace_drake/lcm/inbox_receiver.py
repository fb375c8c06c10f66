"""InboxReceiver: what systems have in common that take the newest message of a channel into their state."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.lcm.inbox import Inbox
from pace_drake.ports import declare_output

#: Places in the state that every receiver has: messages so far, and context time [s] at which the newest was taken in.
COUNT, ARRIVAL = 0, 1


class InboxReceiver(LeafSystem):
    """Takes the newest message of an Inbox into its state, at initialization and at every step.

    Outputs depend on state and time only, so that all who read them at one instant agree.

    Attributes:
        inbox: counts what was dropped, and says why.

    Args:
        inbox: where the messages arrive.
        initial: state before the first message, from place 2 on.
        age: name of the output that says how long ago [s] the newest message was taken in; infinite before the first.
    """

    def __init__(self, inbox: Inbox, initial: np.ndarray, age: str) -> None:
        super().__init__()
        self.inbox = inbox
        self.DeclareDiscreteState(np.concatenate([[0.0, -np.inf], initial]))
        self.DeclareInitializationDiscreteUpdateEvent(self.Update)
        self.DeclarePerStepDiscreteUpdateEvent(self.Update)
        now = {self.xd_ticket(), self.time_ticket()}
        declare_output(self, age, lambda context: context.get_time() - self._x(context)[ARRIVAL], now)

    @staticmethod
    def _x(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _declare(self, name: str, places: slice) -> None:
        """Puts part of the state out."""
        size = places.stop - places.start
        declare_output(self, name, lambda context: self._x(context)[places], {self.xd_ticket()}, size=size)

    def Update(self, context: Context, discrete_state: DiscreteValues) -> None:
        """Takes in the newest message."""
        if self.inbox.num_good == self._x(context)[COUNT]:
            return
        x = discrete_state.get_mutable_value(0)
        x[COUNT], x[ARRIVAL] = self.inbox.num_good, context.get_time()
        self._take(x, self.inbox.newest)

    def _take(self, x: np.ndarray, message: Any) -> None:
        """Writes what is kept of a message into the state, from place 2 on."""
        raise NotImplementedError
