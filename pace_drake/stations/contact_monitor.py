"""ContactMonitor: how deep bodies are in one another, and whether the robot touches itself."""

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.systems.framework import BasicVector, Context, LeafSystem


class ContactMonitor(LeafSystem):
    """Looks at a plant's point contacts.

    Inputs:
        contact_results: Drake's ContactResults.

    Outputs:
        contact (2): largest penetration [m], 0 without contact; number of contacts between two bodies of the robot.

    Args:
        plant: finalized; the robot is its model instance "panda".
    """

    def __init__(self, plant: MultibodyPlant) -> None:
        super().__init__()
        self.set_name("contact_monitor")
        self._robot = set(plant.GetBodyIndices(plant.GetModelInstanceByName("panda")))
        self._results = self.DeclareAbstractInputPort("contact_results", AbstractValue.Make(ContactResults()))
        self.DeclareVectorOutputPort(
            "contact", BasicVector(2), self.CalcContact, {self.input_port_ticket(self._results.get_index())}
        )

    def CalcContact(self, context: Context, output: BasicVector) -> None:
        """Goes through the pairs."""
        results: ContactResults = self._results.Eval(context)
        robot = self._robot
        pairs = [results.point_pair_contact_info(k) for k in range(results.num_point_pair_contacts())]
        deepest = max([info.point_pair().depth for info in pairs], default=0.0)
        own = sum([info.bodyA_index() in robot and info.bodyB_index() in robot for info in pairs])
        output.SetFromVector([deepest, own])
