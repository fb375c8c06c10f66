"""A system alone, advanced in steps, with its outputs at hand."""

from pydrake.lcm import DrakeLcm
from pydrake.systems.analysis import Simulator


class Stepped:
    """``make(lcm)`` makes the system; messages are handed over before each advance, as a loop does."""

    def __init__(self, make):
        self.lcm = DrakeLcm("memq://")
        self.dut = make(self.lcm)
        self.simulator = Simulator(self.dut)
        self.context = self.simulator.get_mutable_context()

    def send(self, channel, *messages):
        for message in messages:
            self.lcm.Publish(channel, message)
        self.lcm.HandleSubscriptions(0)

    def initialize(self):
        self.context.SetTime(0.0)
        self.simulator.Initialize()

    def advance(self, time):
        self.simulator.AdvanceTo(time)

    def __getitem__(self, output):
        value = self.dut.GetOutputPort(output).Eval(self.context)
        return value[0] if len(value) == 1 else value.tolist()
