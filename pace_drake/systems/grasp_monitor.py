"""GraspMonitor: notices that the gripper does not hold what it has fetched (docs/safety.md)."""

from math import inf

from pydrake.systems.framework import Context, DiscreteValues, InputPort, LeafSystem

from pace_drake.ports import declare_input, declare_output
from pace_drake.safety.config import SafetyConfig
from pace_drake.stations.components import closed_width, component_index, components
from pace_drake.stations.workcell import Workcell
from pace_drake.task import ActionKind

#: Places in the state.
_LATCHED, _ACK, _SINCE, _DOUBT, _REPORTED, _NUM_LOST, _COMPONENT, _WIDTH, _ANEW = range(9)

_FETCHING = (ActionKind.ROBOT_TASK, ActionKind.PREPARE)
#: In these the gripper holds what the preparation has fetched, until it opens.
_OF_PREPARED = (ActionKind.PREPARE, ActionKind.JOINT, ActionKind.HOME_ABORTED)
_ROUNDING = 1e-9  # [m]
#: [s] for which a width must be wrong: longer than between two statuses of a hand, of which one may lie.
CONFIRMATION = 0.15


class GraspMonitor(LeafSystem):
    """Compares the width between the fingers with that of what they are meant to hold, and raises ``fault``.

    A thing is meant to be held while the commanded width is that of the gripper closed on it. Fingers that come nearer
    than its width less the tolerance have nothing, or something else, in between: on their way from open they are
    wider. Fingers that, after the settle time, are wider than its width and the tolerance have not closed. Both must
    last for ``CONFIRMATION``. Each grasp is reported once, until the gripper is told to open.

    Inputs:
        motion_progress (3), gripper_position (1) [m]: of RobotAction; the commanded width.
        gripper_state (2) [m, m/s]: the measured width and its rate.
        gripper_age (1) [s]: how old that is; unconnected, it is new. What is too old is not judged.
        fault (1): from outside, passed through; unconnected, there is none.
        ack (1): the operator's; unconnected, never.

    Outputs:
        fault (1): 1 if that from outside is, or from when something was found lost until an ``ack`` rises.
        num_lost (1): how often something was.

    State:
        [fault latched, ack at the last look, time since which something is meant to be held [s] (inf: nothing is), and
        since which the width is wrong [s] (inf: it is not), whether this grasp was reported, num_lost; of the last one
        reported: index of the component, width between the fingers [m], whether the motion was still fetching it].

    Events:
        update: every ``config.period``.

    Args:
        config: validated settings.
        workcell: what there is to be held, and how far the gripper closes on it.
        max_age: [s] of a measured width that is judged.
    """

    def __init__(self, config: SafetyConfig, workcell: Workcell, max_age: float = inf) -> None:
        super().__init__()
        self.set_name("grasp_monitor")
        self._config, self._workcell, self._max_age = config, workcell, max_age
        self._components = components(workcell)
        self.DeclareDiscreteState([0.0, 0.0, inf, inf, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._progress = declare_input(self, "motion_progress", 3)
        self._commanded = declare_input(self, "gripper_position")
        self._measured = declare_input(self, "gripper_state", 2)
        self._age = declare_input(self, "gripper_age")
        self._fault = declare_input(self, "fault")
        self._ack = declare_input(self, "ack")
        state = self.xd_ticket()
        declare_output(self, "fault", self._calc_fault, {state, self.input_port_ticket(self._fault.get_index())})
        declare_output(self, "num_lost", lambda context: self._x(context)[_NUM_LOST], {state})
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    @staticmethod
    def _x(context: Context):
        return context.get_discrete_state_vector().value()

    @staticmethod
    def _optional(port: InputPort, context: Context) -> float:
        return port.Eval(context)[0] if port.HasValue(context) else 0.0

    @classmethod
    def latched(cls, context: Context) -> bool:
        """Whether something was found lost and that has not been acknowledged."""
        return bool(cls._x(context)[_LATCHED])

    @classmethod
    def num_lost(cls, context: Context) -> int:
        """How often something was found lost."""
        return int(cls._x(context)[_NUM_LOST])

    def describe(self, context: Context) -> str:
        """One line that says what is lost and what to do; empty if nothing is, or it has been acknowledged."""
        x = self._x(context)
        if not x[_LATCHED]:
            return ""
        component = self._components[int(x[_COMPONENT])]
        remedy = (
            "put it where it belongs, then acknowledge: it is fetched anew"
            if x[_ANEW]
            else "see to it by hand, then acknowledge: the action goes on without it"
        )
        return (
            f"the gripper does not hold {component.name}: its fingers are {1e3 * x[_WIDTH]:.0f} mm apart instead of"
            f" {1e3 * component.grasp.width:.0f}; {remedy}"
        )

    def _calc_fault(self, context: Context) -> float:
        return float(bool(self._optional(self._fault, context)) or self.latched(context))

    def _meant(self, context: Context) -> int | None:
        """Index of the component that is meant to be held; None if none is."""
        kind, index = (int(value) for value in self._progress.Eval(context)[:2])
        if kind == ActionKind.ROBOT_TASK:
            number = component_index(self._workcell, ActionKind.ROBOT_TASK, index)
        elif kind in _OF_PREPARED:
            number = component_index(self._workcell, ActionKind.PREPARE, index)
        else:
            return None
        assert number is not None
        closed = closed_width(self._workcell, self._components[number])
        return number if self._commanded.Eval(context)[0] <= closed + _ROUNDING else None

    def _update(self, context: Context, values: DiscreteValues) -> None:
        x = values.get_mutable_value(0)
        ack = self._optional(self._ack, context)
        if ack and not x[_ACK]:
            x[_LATCHED] = 0.0
        x[_ACK] = ack
        number = self._meant(context)
        if number is None:
            x[_SINCE], x[_DOUBT], x[_REPORTED] = inf, inf, 0.0
            return
        time = context.get_time()
        x[_SINCE] = min(x[_SINCE], time)
        if x[_REPORTED] or self._optional(self._age, context) > self._max_age:
            return
        config, width = self._config, self._measured.Eval(context)[0]
        excess = width - self._components[number].grasp.width
        settled = time >= x[_SINCE] + config.grasp_settle_time
        wrong = excess < -config.grasp_tolerance or (settled and not excess <= config.grasp_tolerance)
        x[_DOUBT] = min(x[_DOUBT], time) if wrong else inf
        if time >= x[_DOUBT] + CONFIRMATION:
            kind, _, fraction = self._progress.Eval(context)
            x[_LATCHED], x[_REPORTED], x[_COMPONENT], x[_WIDTH] = 1.0, 1.0, number, width
            x[_NUM_LOST] += 1
            # What was fetched for a joint action cannot be fetched again once the robot has it ready.
            x[_ANEW] = kind in _FETCHING and fraction < 1.0
