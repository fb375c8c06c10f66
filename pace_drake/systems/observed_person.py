"""ObservedPerson: what the robot's own part tells of a real person, where a simulated one would be asked."""

from math import nan

from pydrake.systems.framework import Context, DiscreteValues, LeafSystem

from pace_drake.ports import declare_input, declare_output, declare_update
from pace_drake.task import ActionKind, Episode

_JOINT = float(ActionKind.JOINT)


class ObservedPerson(LeafSystem):
    """Stands where ``Human`` does when the person is real.

    A joint action is over when the robot's motion in it is: the robot holds on to a thing until the person's hand has
    it. What the person does alone is the ActionMonitor's to say; nobody knows it truly.

    The chart leaves a joint action when its motion is done and ``joints_done`` says so. The latter follows one update
    after the former, whatever happens between the two: a stop makes the chart issue the same command again, or another
    for the same joint action when it had not been finished, and either comes to an end as a JOINT with that index.

    Inputs:
        robot_action (3): kind, index, sequence number of the robot's command.
        motion_done (1): sequence number of the last finished command.
        joint_ready (1): l while the robot is ready to perform, or performs, joint action l with the person, else 0.
        human_joint (1): l at which the person is, as the ActionMonitor says, else 0.

    Outputs:
        joints_done (1): number of joint actions finished.
        human_waiting (1): 1 while the person is at a joint action that is not over, and the robot not in it; so, too,
            while it is stopped in it.

    State:
        [joint actions finished].

    Events:
        update: notes that a joint action is finished (forced or periodic).

    Args:
        reaction_period: see ``declare_update``.
    """

    def __init__(self, reaction_period: float | None = None) -> None:
        super().__init__()
        self.set_name("observed_person")
        self.DeclareDiscreteState(1)
        self._robot_action = declare_input(self, "robot_action", 3)
        self._motion_done = declare_input(self, "motion_done")
        self._joint_ready = declare_input(self, "joint_ready")
        self._human_joint = declare_input(self, "human_joint")
        read = {self.input_port_ticket(port.get_index()) for port in (self._joint_ready, self._human_joint)}
        declare_output(self, "joints_done", self._joints_done, {self.xd_ticket()})
        declare_output(self, "human_waiting", self._human_waiting, {self.xd_ticket()} | read)
        declare_update(self, self._update, reaction_period)

    def set_episode(self, context: Context, episode: Episode) -> None:
        """Begins anew; what a real person will do is not drawn."""
        context.SetDiscreteState([0.0])

    def progress(self, context: Context) -> float:
        """NaN: how far a real person truly is nobody knows; see ``Human.progress``."""
        return nan

    @staticmethod
    def _joints_done(context: Context) -> float:
        return context.get_discrete_state_vector().GetAtIndex(0)

    def _human_waiting(self, context: Context) -> float:
        joint = self._human_joint.Eval(context)[0]
        return float(joint > self._joints_done(context) and self._joint_ready.Eval(context)[0] != joint)

    def _update(self, context: Context, values: DiscreteValues) -> None:
        kind, joint, sequence = self._robot_action.Eval(context)
        if kind == _JOINT and self._motion_done.Eval(context)[0] == sequence:
            values.set_value(0, [max(joint, self._joints_done(context))])
