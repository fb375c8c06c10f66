"""Observation: what the policy sees (paper, O(s))."""

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from pace_drake.observation import OBSERVATION, OBSERVATION_SETS
from pace_drake.ports import declare_input, declare_output


class Observation(LeafSystem):
    """Collects an observation; of the set ``paper`` it is O(s) = (a_i^R, a_j^H, Delta_start^H, tau).

    Values are rounded to single precision, the precision of the learned policies, so that a policy decides the same
    inside the diagram and outside it.

    Inputs:
        robot_task (1): i; human_action (1): j; human_elapsed (1) [s]; and, where the set has them, phase (1) in
        [0, 1]; phase_std (1); remaining_time (2) [s], of which the mean is taken; pace (1).

    Outputs:
        observation (D): the same, in this order.

    Args:
        observation_set: see ``pace_drake.observation``.
    """

    def __init__(self, observation_set: str = "paper") -> None:
        super().__init__()
        self.set_name("observation")
        size = OBSERVATION_SETS[observation_set]
        self._ports = [declare_input(self, name, 2 if name == "remaining_time" else 1) for name in OBSERVATION[:size]]
        declare_output(self, "observation", self._observe, {self.all_input_ports_ticket()}, size=size)

    def _observe(self, context: Context) -> np.ndarray:
        return np.array([port.Eval(context)[0] for port in self._ports], dtype=np.float32).astype(float)
