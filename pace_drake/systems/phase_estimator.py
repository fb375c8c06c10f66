"""PhaseEstimator: how far the current human action has come, from the hand's motion."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.dtw import OpenEndKernel
from pace_drake.systems.ports import declare_input, declare_output


class PhaseEstimator(LeafSystem):
    """Streaming open-end soft-DTW (Algorithm 1): one row of the alignment per hand sample, of the current action only.

    Inputs:
        p_WH (3) [m]: hand samples.
        human_action (1): j [1-based].

    Outputs:
        phase (1) in [0, 1]: estimated progress tau of action j; 1 in actions without a reference (joint actions and
            waiting for them, see docs/departures.md); 0 before the action's first sample.

    State:
        [action of the row, the estimator's numeric vector]; cleared when the action changes.

    Events:
        Periodic update at ``sample_period``, the tracker's rate.

    Args:
        kernels: for each human action its estimator, None for joint actions.
        sample_period: [s].
    """

    def __init__(self, kernels: Sequence[OpenEndKernel | None], sample_period: float = 0.1) -> None:
        super().__init__()
        self.set_name("phase_estimator")
        self._kernels = list(kernels)
        # Ends of the estimators' vectors in the state, which begins with the action.
        self._ends = [1 + (0 if kernel is None else kernel.num_states) for kernel in kernels]
        self.DeclareDiscreteState(max(self._ends))
        self._p_WH = declare_input(self, "p_WH", 3)
        self._human_action = declare_input(self, "human_action")
        declare_output(
            self,
            "phase",
            self._phase,
            {self.xd_ticket(), self.input_port_ticket(self._human_action.get_index())},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(sample_period, 0.0, self._update)

    def _phase(self, context: Context) -> float:
        action = int(self._human_action.Eval(context)[0])
        kernel = self._kernels[action - 1]
        if kernel is None:
            return 1.0
        state = context.get_discrete_state_vector().value()
        return kernel.phase(state[1 : self._ends[action - 1]]) if int(state[0]) == action else 0.0

    def _update(self, context: Context, values: DiscreteValues) -> None:
        action = int(self._human_action.Eval(context)[0])
        state: np.ndarray = values.get_mutable_value(0)
        kernel = self._kernels[action - 1]
        if kernel is not None:
            row = state[1 : self._ends[action - 1]]
            if int(state[0]) != action:
                row[:] = kernel.initial_state()
            kernel.update(row, self._p_WH.Eval(context))
        state[0] = action
