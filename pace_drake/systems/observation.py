"""Observation: what the policy sees (paper, O(s))."""

import numpy as np
from pydrake.systems.framework import Context, LeafSystem

from pace_drake.systems.ports import declare_input, declare_output

#: Elements of the observation, in order.
OBSERVATION = ("robot_task", "human_action", "human_elapsed", "phase")


class Observation(LeafSystem):
    """Collects the paper's observation O(s) = (a_i^R, a_j^H, Delta_start^H, tau).

    Values are rounded to single precision, the precision of the learned policies, so that a policy decides the same
    inside the diagram and outside it.

    Inputs:
        robot_task (1): i; human_action (1): j; human_elapsed (1) [s]; phase (1) in [0, 1].

    Outputs:
        observation (4): the same, in this order.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_name("observation")
        self._ports = [declare_input(self, name) for name in OBSERVATION]
        declare_output(self, "observation", self._observe, {self.all_input_ports_ticket()}, size=len(OBSERVATION))

    def _observe(self, context: Context) -> np.ndarray:
        return np.array([port.Eval(context)[0] for port in self._ports], dtype=np.float32).astype(float)
