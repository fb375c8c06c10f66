"""Decision: a policy inside the diagram."""

from pydrake.systems.framework import Context, LeafSystem

from pace_drake.observation import OBSERVATION_SETS
from pace_drake.policies import Policy
from pace_drake.ports import declare_input, declare_output


class Decision(LeafSystem):
    """Answers the statechart's question, to assist or not, by a policy.

    Inputs:
        observation (D): of the policy's observation set, see ``Observation``.

    Outputs:
        assist (1) in {-1, 0, 1}; -1 if the policy has no answer.

    Args:
        policy: a function of the observation alone.
    """

    def __init__(self, policy: Policy) -> None:
        super().__init__()
        self.set_name("decision")
        self._policy = policy
        self._observation = declare_input(self, "observation", OBSERVATION_SETS[policy.observation])
        declare_output(self, "assist", self._assist, {self.all_input_ports_ticket()})

    def _assist(self, context: Context) -> float:
        return float(self._policy.decide(self._observation.Eval(context)))
