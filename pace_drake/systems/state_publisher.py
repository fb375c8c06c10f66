"""StatePublisher: where the collaboration stands, over LCM."""

import time
from collections.abc import Callable, Sequence

from pydrake.systems.framework import Context, LeafSystem

from pace_drake.lcm.link import Lcm
from pace_drake.lcm.types import lcmt_pace_state
from pace_drake.ports import declare_input

#: [s] between two messages.
PERIOD = 0.05


class StatePublisher(LeafSystem):
    """Publishes ``lcmt_pace_state``, for viewers and for a person who is simulated in another process.

    Inputs:
        mode (1), robot_task (1), joint_ready (1), robot_waiting (1): of the TaskStatechart.
        human_action (1): j as the robot knows it; human_waiting (1); phase (1).

    Events:
        publish: every ``PERIOD``.

    Args:
        lcm: where they are published.
        leaves: leaf states of the chart, as ``mode`` counts them.
        channel: its name.
        clock: wall clock [s since the Unix epoch] that stamps the messages.
    """

    def __init__(
        self, lcm: Lcm, leaves: Sequence[str], channel: str = "PACE_STATE", clock: Callable[[], float] = time.time
    ) -> None:
        super().__init__()
        self.set_name("state_publisher")
        self._lcm, self._leaves, self._channel, self._clock = lcm, leaves, channel, clock
        self._mode, self._human_waiting, self._phase = (
            declare_input(self, name) for name in ("mode", "human_waiting", "phase")
        )
        names = ("robot_task", "joint_ready", "robot_waiting", "human_action")
        self._numbers = {name: declare_input(self, name) for name in names}
        self.DeclarePeriodicPublishEvent(PERIOD, 0.0, self._publish)

    def _publish(self, context: Context) -> None:
        message = lcmt_pace_state()
        message.utime, message.time = int(1e6 * self._clock()), context.get_time()
        message.leaf = self._leaves[int(self._mode.Eval(context)[0])]
        for name, port in self._numbers.items():
            setattr(message, name, int(port.Eval(context)[0]))
        message.human_waiting = bool(self._human_waiting.Eval(context)[0])
        message.phase = float(self._phase.Eval(context)[0])
        self._lcm.Publish(self._channel, message.encode())
