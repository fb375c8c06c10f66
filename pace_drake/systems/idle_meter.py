"""IdleMeter: who waited for whom, and what it cost (paper, Eq. 1)."""

import numpy as np
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.ports import declare_input, declare_output, declare_update


class IdleMeter(LeafSystem):
    """Adds up idle time per joint action.

    Inputs:
        robot_waiting (1): l while the robot waits, prepared, for joint action l, else 0.
        human_waiting (1): 1 while the person waits for the robot.
        human_joint (1): l at which the person waits.

    Outputs:
        robot_idle (L) [s], human_idle (L) [s]: up to now, per joint action.
        cost (1) [s]: sum of robot_idle + lambda * sum of human_idle.

    State:
        [time of the last update [s], robot waits at l or 0, human waits at l or 0, robot (L) [s], human (L) [s]].

    Args:
        num_joint_actions: L.
        human_idle_weight: lambda.
        reaction_period: see ``declare_update``.
    """

    def __init__(self, num_joint_actions: int, human_idle_weight: float, reaction_period: float | None = None) -> None:
        super().__init__()
        self.set_name("idle_meter")
        self._joints = num_joint_actions
        self._weight = human_idle_weight
        self.DeclareDiscreteState(3 + 2 * num_joint_actions)
        self._robot_waiting = declare_input(self, "robot_waiting")
        self._human_waiting = declare_input(self, "human_waiting")
        self._human_joint = declare_input(self, "human_joint")
        now = {self.xd_ticket(), self.time_ticket()}
        declare_output(self, "robot_idle", lambda context: self._idle(context)[0], now, size=num_joint_actions)
        declare_output(self, "human_idle", lambda context: self._idle(context)[1], now, size=num_joint_actions)
        declare_output(self, "cost", self._cost, now)
        declare_update(self, self._update, reaction_period)

    def _idle(self, context: Context) -> np.ndarray:
        """(2, L) [s] robot and human idle time up to now."""
        state = context.get_discrete_state_vector().value()
        idle = state[3:].reshape(2, self._joints).copy()
        for agent in (0, 1):
            if at := int(state[1 + agent]):
                idle[agent, at - 1] += context.get_time() - state[0]
        return idle

    def _cost(self, context: Context) -> float:
        robot, human = self._idle(context)
        return robot.sum() + self._weight * human.sum()

    def _update(self, context: Context, values: DiscreteValues) -> None:
        human = self._human_joint.Eval(context)[0] if self._human_waiting.Eval(context)[0] else 0.0
        values.set_value(
            np.concatenate(
                [
                    [context.get_time(), self._robot_waiting.Eval(context)[0], human],
                    self._idle(context).ravel(),
                ]
            )
        )
