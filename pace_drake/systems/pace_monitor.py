"""PaceMonitor: how fast this person has been so far."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.ports import declare_input, declare_output, declare_update
from pace_drake.task import Task


class PaceMonitor(LeafSystem):
    """The mean ratio of a person's finished actions to what they take on average.

    Inputs:
        human_action (1): j [1-based]; human_elapsed (1) [s]: time since it, or the waiting for it, began.

    Outputs:
        pace (1): mean over the finished non-joint actions of duration / mean duration; above 1 is slow, 1 before the
            first. An action that has just ended counts at once.

    State:
        [action seen last, when it began [s], sum of the ratios, how many].

    Events:
        update: notices that an action is over (forced or periodic).

    Args:
        task: gives the mean durations.
        reaction_period: see ``declare_update``.
    """

    def __init__(self, task: Task, reaction_period: float | None = None) -> None:
        super().__init__()
        self.set_name("pace_monitor")
        self._mean = [0.0 if action.joint else action.duration.mean for action in task.human_actions]
        self.DeclareDiscreteState([1.0, 0.0, 0.0, 0.0])
        self._action = declare_input(self, "human_action")
        self._elapsed = declare_input(self, "human_elapsed")
        everything = {self.xd_ticket(), self.time_ticket(), self.all_input_ports_ticket()}
        declare_output(self, "pace", self._pace, everything)
        declare_update(self, self._update, reaction_period)

    def _now(self, context: Context) -> np.ndarray:
        """The state, with an action that is over counted."""
        state = context.get_discrete_state_vector().value().copy()
        action = self._action.Eval(context)[0]
        if action != state[0]:
            began = context.get_time() - self._elapsed.Eval(context)[0]
            mean = self._mean[int(state[0]) - 1]
            if mean > 0:
                state[2] += (began - state[1]) / mean
                state[3] += 1
            state[:2] = action, began
        return state

    def _pace(self, context: Context) -> float:
        *_, total, count = self._now(context)
        return float(total / count) if count else 1.0

    def _update(self, context: Context, values: DiscreteValues) -> None:
        values.get_mutable_value(0)[:] = self._now(context)
