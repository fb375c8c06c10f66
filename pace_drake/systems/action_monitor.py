"""ActionMonitor: which action the person is in, without being told the truth."""

from collections.abc import Sequence
from math import floor, isfinite

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.dtw.end import EndDetector
from pace_drake.ports import declare_input, declare_output, declare_update
from pace_drake.task import Task


class ActionMonitor(LeafSystem):
    """Follows the person through the task by what can be observed: the hand, a button, and the robot's own part.

    A non-joint action ends when its detector says so or when the person presses the button, whichever comes first; a
    joint action ends when the robot has felt it end. So a false or late end is one of the robot's idea of the
    person only: the person goes on as they are.

    Inputs:
        p_WH (3) [m]: the hand; a sample that is not a number, as before a tracker's first, is left out.
        joints_done (1): number of joint actions finished.
        button (1): how often the button was pressed; unconnected, it never was.

    Outputs:
        human_action (1): j [1-based]; N after the end.
        human_elapsed (1) [s]: time since action j began; in a joint action, time since waiting for it began.
        human_joint (1): l in joint action l or waiting for it, else 0.
        next_event_time (1) [s]: of the next hand sample, at which the state may change.

    State:
        [j, time at which j began [s], time of the next sample [s], button presses seen, state of j's detector].

    Events:
        update: takes a sample when one is due (forced or periodic).

    Args:
        task: a validated task.
        detectors: for each human action its end detector; None for joint actions, and everywhere if only the button
            counts.
        sample_period: [s] of the hand tracker.
        reaction_period: see ``declare_update``.
    """

    def __init__(
        self,
        task: Task,
        detectors: Sequence[EndDetector | None],
        sample_period: float = 0.1,
        reaction_period: float | None = None,
    ) -> None:
        super().__init__()
        self.set_name("action_monitor")
        self._n = task.num_human_actions
        self._joint_of = {j: joint for joint, j in enumerate(task.human_index_of_joint, start=1)}
        self._detectors = list(detectors)
        self._sample_period = sample_period
        sizes = [0 if detector is None else detector.num_states for detector in detectors]
        self.DeclareDiscreteState(self._begun(1, 0.0, 0.0, 0.0, max(sizes)))
        self._p_WH = declare_input(self, "p_WH", 3)
        self._joints_done = declare_input(self, "joints_done")
        self._button = declare_input(self, "button")
        state, now = {self.xd_ticket()}, {self.xd_ticket(), self.time_ticket()}
        declare_output(self, "human_action", lambda context: self._x(context)[0], state)
        declare_output(self, "human_elapsed", lambda context: context.get_time() - self._x(context)[1], now)
        declare_output(self, "human_joint", lambda context: self._joint_of.get(int(self._x(context)[0]), 0), state)
        declare_output(self, "next_event_time", lambda context: self._x(context)[2], state)
        declare_update(self, self._update, reaction_period)

    def _begun(self, action: int, time: float, next_sample: float, presses: float, size: int) -> np.ndarray:
        """The state of an action that begins now."""
        x = np.zeros(4 + size)
        x[:4] = action, time, next_sample, presses
        detector = self._detectors[action - 1]
        if detector is not None:
            x[4 : 4 + detector.num_states] = detector.initial_state()
        return x

    def begin(self, context: Context) -> None:
        """Lets the first action begin at the context's time; what was pressed before does not count."""
        time = context.get_time()
        presses = self._button.Eval(context)[0] if self._button.HasValue(context) else 0.0
        size = self._x(context).size - 4
        context.SetDiscreteState(self._begun(1, time, time, presses, size))

    @staticmethod
    def _x(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _update(self, context: Context, values: DiscreteValues) -> None:
        x: np.ndarray = values.get_mutable_value(0)
        time, action = context.get_time(), int(x[0])
        # A billionth of a period: a sample must not be missed by rounding.
        due = time >= x[2] - 1e-9 * self._sample_period
        if due:
            x[2] = (floor(time / self._sample_period + 1e-9) + 1) * self._sample_period
        presses = self._button.Eval(context)[0] if self._button.HasValue(context) else 0.0
        joint, detector = self._joint_of.get(action), self._detectors[action - 1]
        if joint is not None:
            ended = self._joints_done.Eval(context)[0] >= joint
        else:
            ended = presses > x[3]
            if detector is not None and due:
                state, p_WH = x[4 : 4 + detector.num_states], self._p_WH.Eval(context)
                if isfinite(p_WH.sum()):
                    detector.step(state, p_WH)
                ended = ended or detector.ended_at(state)
        x[3] = presses
        if ended and action < self._n:
            x[:] = self._begun(action + 1, time, float(x[2]), presses, x.size - 4)
