"""PhaseEstimator: how far the current human action has come, from the hand's motion."""

from collections.abc import Sequence
from math import isfinite

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, EventStatus, LeafSystem

from pace_drake.dtw.estimator import Estimate, Estimator
from pace_drake.ports import declare_input, declare_output

#: In actions without an estimator, that is joint actions and waiting for them: nothing is left of the person's own.
_DONE = Estimate(1.0, phase_std=0.0, remaining_time=0.0, remaining_time_std=0.0)


class PhaseEstimator(LeafSystem):
    """A streaming phase estimator (Algorithm 1): one step per hand sample, of the current action only.

    Inputs:
        p_WH (3) [m]: hand samples; one that is not a number, as before a tracker's first, is left out.
        human_action (1): j [1-based].

    Outputs:
        phase (1) in [0, 1]: estimated progress tau of action j; 1 in actions without an estimator (joint actions and
            waiting for them, see docs/departures.md); 0 before the action's first sample.
        phase_std (1): standard deviation of the phase; NaN where the estimator gives none, 0 in joint actions.
        phase_rate (1) [1/s]: speed of the phase; NaN where the estimator gives none, and in joint actions.
        remaining_time (2) [s]: mean and standard deviation of the time to the action's end; as phase_std.

    State:
        [action of the estimator's state, that state]; cleared when the action changes.

    Events:
        Periodic update at ``sample_period``, the tracker's rate.

    Args:
        estimators: for each human action its own, None for joint actions.
        sample_period: [s].
    """

    def __init__(self, estimators: Sequence[Estimator | None], sample_period: float = 0.1) -> None:
        super().__init__()
        self.set_name("phase_estimator")
        self._estimators = list(estimators)
        # Ends of the estimators' vectors in the state, which begins with the action.
        self._ends = [1 + (0 if one is None else one.num_states) for one in estimators]
        self.DeclareDiscreteState(max(self._ends))
        self._p_WH = declare_input(self, "p_WH", 3)
        self._human_action = declare_input(self, "human_action")
        depends_on = {self.xd_ticket(), self.input_port_ticket(self._human_action.get_index())}
        declare_output(self, "phase", self._phase, depends_on)
        declare_output(self, "phase_std", lambda context: self._estimate(context).phase_std, depends_on)
        declare_output(self, "phase_rate", lambda context: self._estimate(context).rate, depends_on)
        declare_output(self, "remaining_time", self._remaining_time, depends_on, size=2)
        self.DeclarePeriodicDiscreteUpdateEvent(sample_period, 0.0, self._update)

    def _at(self, context: Context) -> tuple[Estimator | None, np.ndarray]:
        """The current action's estimator and its state; a new state before the action's first sample."""
        action = int(self._human_action.Eval(context)[0])
        estimator = self._estimators[action - 1]
        state = context.get_discrete_state_vector().value()
        if estimator is None:
            return None, state[:0]
        if int(state[0]) != action:
            return estimator, estimator.initial_state()
        return estimator, state[1 : self._ends[action - 1]]

    def _phase(self, context: Context) -> float:
        estimator, state = self._at(context)
        return 1.0 if estimator is None else estimator.phase_at(state)

    def _estimate(self, context: Context) -> Estimate:
        estimator, state = self._at(context)
        return _DONE if estimator is None else estimator.estimate_at(state)

    def _remaining_time(self, context: Context) -> tuple[float, float]:
        estimate = self._estimate(context)
        return float(estimate.remaining_time), float(estimate.remaining_time_std)

    def _update(self, context: Context, values: DiscreteValues) -> EventStatus:
        action = int(self._human_action.Eval(context)[0])
        state: np.ndarray = values.get_mutable_value(0)
        estimator = self._estimators[action - 1]
        if estimator is None and int(state[0]) == action:
            return EventStatus.DidNothing()  # so that Drake does not copy the state
        if estimator is not None:
            of_action = state[1 : self._ends[action - 1]]
            if int(state[0]) != action:
                of_action[:] = estimator.initial_state()
            p_WH = self._p_WH.Eval(context)
            if isfinite(sum(p_WH.tolist())):
                estimator.step(of_action, p_WH)
        state[0] = action
        return EventStatus.Succeeded()
