"""The person over LCM: what a tracker and buttons say, as one Diagram for ``Assembly``."""

from pydrake.systems.framework import Diagram, DiagramBuilder

from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.link import Lcm
from pace_drake.systems.hand_receiver import HandReceiver
from pace_drake.systems.operator_receiver import OperatorReceiver


class TrackedPerson(Diagram):
    """A real person: their hand and the buttons, theirs and the operator's, by the channels of an LcmConfig.

    Outputs:
        p_WH (3) [m], hand_age (1) [s], num_samples (1): see ``HandReceiver``.
        stop (1), ack (1), button (1): see ``OperatorReceiver``.

    Attributes:
        hand, operator: its systems; their ``inbox`` counts what was dropped.

    Args:
        config: the channels.
        lcm: from ``pace_drake.lcm.url.open_lcm``.
    """

    def __init__(self, config: LcmConfig, lcm: Lcm) -> None:
        super().__init__()
        builder = DiagramBuilder()
        self.hand: HandReceiver = builder.AddSystem(HandReceiver(lcm, config.person_hand_channel))
        self.operator: OperatorReceiver = builder.AddSystem(OperatorReceiver(lcm, config.operator_channel))
        for system in (self.hand, self.operator):
            for k in range(system.num_output_ports()):
                port = system.get_output_port(k)
                builder.ExportOutput(port, port.get_name())
        builder.BuildInto(self)
        self.set_name("person")
