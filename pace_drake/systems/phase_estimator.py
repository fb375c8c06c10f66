"""PhaseEstimator: how far the current human action has come, from the hand's motion."""

from collections.abc import Sequence
from math import isfinite

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, EventStatus, LeafSystem

from pace_drake.dtw.estimator import Estimate, Estimator
from pace_drake.ports import declare_input, declare_output, declare_update

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
        update: takes a sample: forced, as ``pace_drake.simulation.Simulation`` does at the tracker's rate, or periodic
            at that rate.

    Args:
        estimators: for each human action its own, None for joint actions.
        sample_period: [s] of the tracker.
        periodic: False: only when forced.
    """

    def __init__(
        self, estimators: Sequence[Estimator | None], sample_period: float = 0.1, periodic: bool = True
    ) -> None:
        super().__init__()
        self.sample_period = sample_period
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
        declare_update(self, self._update, sample_period if periodic else None)

    def _at(self, context: Context) -> tuple[Estimator | None, np.ndarray]:
        """The current action's estimator and its state; a new state before the action's first sample."""
        action = int(self._human_action.Eval(context)[0])
        estimator = self._estimators[action - 1]
        state = self._state(context)
        if estimator is None:
            return None, state[:0]
        if state[0] != action:
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

    def idle(self, context: Context) -> bool:
        """Whether updates do nothing as long as the action is the present one, which has no estimator."""
        action = int(self._human_action.Eval(context)[0])
        return self._estimators[action - 1] is None and self._state(context)[0] == action

    def take_sample(self, context: Context) -> bool:
        """Updates in place, without the copies of an update by events; returns whether an estimator is at work."""
        action, p_WH = self._sample(context)
        state = context.get_mutable_discrete_state_vector().get_mutable_value()
        self._take(state, action, p_WH)
        return p_WH is not None

    def _update(self, context: Context, values: DiscreteValues) -> EventStatus:
        if self.idle(context):
            return EventStatus.DidNothing()  # so that Drake does not copy the state
        self._take(values.get_mutable_value(0), *self._sample(context))
        return EventStatus.Succeeded()

    def _sample(self, context: Context) -> tuple[int, np.ndarray | None]:
        """The action and where the hand is; None in an action without an estimator."""
        action = int(self._human_action.Eval(context)[0])
        return action, None if self._estimators[action - 1] is None else self._p_WH.Eval(context)

    def _take(self, state: np.ndarray, action: int, p_WH: np.ndarray | None) -> None:
        estimator = self._estimators[action - 1]
        if estimator is not None and p_WH is not None:
            of_action = state[1 : self._ends[action - 1]]
            if state[0] != action:
                of_action[:] = estimator.initial_state()
            if isfinite(sum(p_WH.tolist())):
                estimator.step(of_action, p_WH)
        state[0] = action

    @staticmethod
    def _state(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()
