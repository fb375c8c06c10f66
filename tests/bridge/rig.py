"""A session, a peer of ours in place of the robot, and a network between them that can be tampered with.

All in one process and on the peer's clock, so that every run is the same. The peer is OURS and no robot.
"""

from collections.abc import Callable

import numpy as np
from pydrake.lcm import DrakeLcm

from pace_drake.bridge.command_check import CommandCheck, check_commands
from pace_drake.bridge.lcm_log import LoggedMessage
from pace_drake.bridge.preflight import preflight
from pace_drake.bridge.session import Session
from pace_drake.lcm.link import LcmLink
from pace_drake.lcm.panda_peer import PandaPeer
from pace_drake.lcm.types import lcmt_pace_operator
from pace_drake.policies.factory import make_policy
from pace_drake.safety.command_gate import GateMode
from pace_drake.stations.components import component_index, components
from pace_drake.task import ActionKind

STATUS_PERIOD = 0.005  # [s]
ACKNOWLEDGE, STOP = lcmt_pace_operator.ACKNOWLEDGE, lcmt_pace_operator.STOP


class TamperedLcm:
    """Another Lcm, whose messages to the handlers go through ``tamper(channel, data) -> messages``."""

    def __init__(self, lcm: DrakeLcm) -> None:
        self._lcm = lcm
        self.tamper: Callable[[str, bytes], list[bytes]] = lambda channel, data: [data]

    def Publish(self, channel: str, buffer: bytes) -> None:
        self._lcm.Publish(channel, buffer)

    def Subscribe(self, channel: str, handler: Callable[[bytes], None]) -> None:
        def handle(data: bytes) -> None:
            for message in self.tamper(channel, data):
                handler(message)

        self._lcm.Subscribe(channel, handle)

    def HandleSubscriptions(self, timeout_millis: int) -> int:
        return self._lcm.HandleSubscriptions(timeout_millis)


class Rig:
    """See the module; ``lines`` is what the session told, ``messages`` the log.

    While ``present``, there is between the fingers what the robot's present action has them close on.
    """

    real_person = False

    def __init__(self, scenario, people, motions, *, start=None, policy="phase_threshold", skew=0.0) -> None:
        self.scenario = scenario
        queue = DrakeLcm("memq://")
        self.network = TamperedLcm(queue)
        self.peer = PandaPeer(
            queue, motions.home if start is None else start, config=scenario.lcm, status_rate=1.0 / STATUS_PERIOD
        )
        self.queue = queue
        self.present = True
        self.lines: list[str] = []
        self.messages: list[LoggedMessage] = []
        self.policy = make_policy(policy, scenario)

        def clock() -> float:
            return self.peer.wall_clock() + skew

        link = LcmLink(self.network, lambda channel, data: self.messages.append(LoggedMessage(clock(), channel, data)))
        self.session = Session(
            scenario,
            self.policy,
            link,
            real_person=self.real_person,
            people=people,
            motions=motions,
            clock=clock,
            steady=self.peer.elapsed,
            tell=self.lines.append,
            poll_timeout=0.0,
        )
        self.episode = self.session.simulation.sample_episode(np.random.default_rng(0))
        self.peer.step(0.0)
        self.session.connect(0.0)

    def run(self, duration: float) -> "Rig":
        for _ in range(round(duration / STATUS_PERIOD)):
            self.peer.between = self._width_between() if self.present else 0.0
            self.peer.step(STATUS_PERIOD)
            self.session.step()
        return self

    def _width_between(self) -> float:
        """[m]"""
        kind, index = self.action()
        if kind not in (ActionKind.ROBOT_TASK, ActionKind.PREPARE, ActionKind.JOINT, ActionKind.HOME_ABORTED):
            return 0.0
        fetching = ActionKind.ROBOT_TASK if kind == ActionKind.ROBOT_TASK else ActionKind.PREPARE
        number = component_index(self.scenario.workcell, fetching, index)
        return components(self.scenario.workcell)[number].grasp.width

    def run_until(self, reached: Callable[[], bool], limit: float = 20.0) -> "Rig":
        end = self.peer.elapsed() + limit
        while not reached():
            assert self.peer.elapsed() < end, f"not reached; told {self.lines}"
            self.run(STATUS_PERIOD)
        return self

    def begin(self, *listeners) -> "Rig":
        """Checks, gives leave, and lets the collaboration begin."""
        self.run(0.3)
        assert all(check.good for check in preflight(self.session)), preflight(self.session)
        self.session.begin(self.episode, listeners)
        self.session.press(ACKNOWLEDGE)
        return self.run_until(lambda: self.session.begun)

    def work(self, *listeners) -> "Rig":
        """Begins and goes on until the arm is in the middle of its first robot task."""
        self.begin(*listeners)
        self.run_until(lambda: self.leaf == "ROBOT_TASK")
        return self.run(1.5)

    def resume(self) -> "Rig":
        """Acknowledges as often as asked to, until the chart runs again."""
        for _ in range(3):
            self.session.press(ACKNOWLEDGE)
            self.run(0.6)
            self.run_until(lambda: self.session.gate_mode != GateMode.JOINING)
            if self.leaf not in ("STOPPED", "FAULT"):
                return self
        raise AssertionError(f"did not resume; told {self.lines}")

    @property
    def leaf(self) -> str:
        return self.session.leaf

    def action(self) -> tuple[int, int]:
        """Kind and index of the motion that runs or ran last."""
        kind, index, _ = self.session.simulation.assembly.robot_action.GetOutputPort("motion_progress").Eval(
            self.session.assembly.robot_action.GetMyContextFromRoot(self.session.simulation.context)
        )
        return int(kind), int(index)

    def fraction(self) -> float:
        """How far that motion has come."""
        action = self.session.assembly.robot_action
        context = action.GetMyContextFromRoot(self.session.simulation.context)
        return float(action.GetOutputPort("motion_progress").Eval(context)[2])

    def check(self) -> CommandCheck:
        """Of all commands that were sent."""
        return check_commands(self.messages, self.scenario.lcm)
