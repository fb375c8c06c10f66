"""DecisionPublisher: each decision over LCM, with what it was made from."""

import time
from collections.abc import Callable
from math import nan
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.lcm.link import Lcm
from pace_drake.lcm.types import lcmt_pace_decision
from pace_drake.ports import declare_input, declare_update
from pace_drake.statechart import Chart
from pace_drake.systems.statechart import TRACE_SIZE, Reaction, read_trace

_TIME, _ASSIST, _PHASE, _OBSERVATION = 0, 1, 2, slice(3, None)


class DecisionPublisher(LeafSystem):
    """Publishes one ``lcmt_pace_decision`` for each decision that the chart has made, also for one that timed out.

    While a decision is asked for it keeps what the chart will see in its update of this very instant, and one period
    later, when the chart's trace says that the decision has fallen, publishes it. So a message comes one period late;
    its ``time`` is that of the decision.

    Inputs:
        observation (D): of the policy's observation set; phase (1).
        assist (1): the answer; unconnected, there is none.
        mode (1), decision_pending (1), decision_index (1), joint_action (1), trace: of the TaskStatechart.

    State:
        [time [s] or NaN if no decision is asked for, assist, phase, observation (D)].

    Events:
        update (forced or periodic): publishes the decision that has fallen since the one before, and keeps what is seen
            now. Where forced, it comes before the chart's; it sees the same values as that.

    Args:
        lcm: where they are published.
        chart: that makes them.
        observation_size: D.
        reaction_period: of the chart; see ``declare_update``.
        channel: its name.
        clock: wall clock [s since the Unix epoch] that stamps the messages.
    """

    def __init__(
        self,
        lcm: Lcm,
        chart: Chart,
        observation_size: int,
        reaction_period: float | None,
        channel: str = "PACE_DECISION",
        clock: Callable[[], float] = time.time,
    ) -> None:
        super().__init__()
        self.set_name("decision_publisher")
        self._lcm, self._chart, self._channel, self._clock = lcm, chart, channel, clock
        asking = {state.id for state in chart.states.values() if state.decision is not None}
        self._asks = [leaf in asking for leaf in chart.leaves]
        # A stop leaves the asking state, too, but answers nothing: it is a transition of a state around it.
        self._answers = {transition.id for transition in chart.transitions if transition.source in asking}
        self._observation = declare_input(self, "observation", observation_size)
        self._phase = declare_input(self, "phase")
        self._assist = declare_input(self, "assist")
        self._mode = declare_input(self, "mode")
        self._pending = declare_input(self, "decision_pending")
        self._index = declare_input(self, "decision_index")
        self._joint_action = declare_input(self, "joint_action")
        self._trace = declare_input(self, "trace", TRACE_SIZE)
        initial: Any = [nan] * (3 + observation_size)
        self.DeclareDiscreteState(initial)
        declare_update(self, self._update, reaction_period)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        self._publish(context)
        x: Any = values.get_mutable_value(0)
        # When its time is up, a decision that was asked for is not pending any more.
        if not (self._pending.Eval(context)[0] or self._asks[int(self._mode.Eval(context)[0])]):
            x[_TIME] = nan
            return
        assist = self._assist.Eval(context)[0] if self._assist.HasValue(context) else nan
        x[_TIME] = context.get_time()
        x[_ASSIST] = assist if assist in (0.0, 1.0) else -1.0
        x[_PHASE] = self._phase.Eval(context)[0]
        x[_OBSERVATION] = self._observation.Eval(context)

    def _publish(self, context: Context) -> None:
        x = context.get_discrete_state_vector().value()
        if np.isnan(x[_TIME]):
            return
        for reaction in read_trace(self._chart, self._trace.Eval(context)):
            if reaction.transition in self._answers:
                self._lcm.Publish(self._channel, self._message(context, x, reaction).encode())

    def _message(self, context: Context, x: np.ndarray, reaction: Reaction) -> lcmt_pace_decision:
        observation = x[_OBSERVATION].tolist()
        robot_task, human_action, elapsed = observation[:3]
        message = lcmt_pace_decision()
        message.utime = int(1e6 * self._clock())
        message.time = reaction.time
        message.decision_index = int(self._index.Eval(context)[0])
        message.assist = int(x[_ASSIST])
        message.robot_task, message.human_action = int(robot_task), int(human_action)
        message.joint_action = int(self._joint_action.Eval(context)[0])
        message.elapsed, message.phase = elapsed, float(x[_PHASE])
        message.transition, message.leaf = reaction.transition, reaction.target
        message.num_observation, message.observation = len(observation), observation
        return message
