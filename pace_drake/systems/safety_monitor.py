"""SafetyMonitor: keeps the arm away from the person's hand by slowing it down on its path (docs/safety.md)."""

from math import isfinite

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, InputPort, LeafSystem, ValueProducer

from pace_drake.ports import declare_input, declare_output
from pace_drake.safety.config import SafetyConfig
from pace_drake.safety.proximity import ArmCapsules, approach
from pace_drake.safety.separation import allowed_rate, allowed_speed
from pace_drake.stations.person import LIMB_RADII, limb_segments
from pace_drake.systems.robot_action import NUM_POSTURES, STOP_TIME, Pacing
from pace_drake.task import ActionKind

#: Places in what is found at one instant.
_RATE, _DISTANCE, _CLOSING = range(3)


def pacing(config: SafetyConfig) -> Pacing:
    """How RobotAction must be led by a SafetyMonitor of these settings.

    It looks ahead as far as the path goes while nothing is noticed yet, and then while it comes to rest.
    """
    return Pacing(period=config.period, look_ahead=config.reaction_time + config.period + STOP_TIME / 2)


class SafetyMonitor(LeafSystem):
    """Speed and separation monitoring between the arm and the person's right hand and forearm.

    A person who comes near slows the robot down, stops it, and lets it go on when they leave: ``speed_scale`` follows
    from the present inputs alone. A hand that is not seen (not a number, or older than ``hand_timeout``) or an arm
    that is not known stops the robot until the operator acknowledges: ``stop`` latches.

    Inputs:
        p_WH (3) [m]: the hand.
        hand_age (1) [s]: how old p_WH is; unconnected, it is new.
        position_measured (7) [rad]: the arm.
        path_position (NUM_POSTURES * 7) [rad], path_velocity (NUM_POSTURES * 7) [rad/s]: of RobotAction.
        motion_progress (3): kind, index, fraction of the motion that runs; in a joint action contact is intended.
        stop (1): the operator's; unconnected, there is none.
        ack (1): the operator's; unconnected, never.

    Outputs:
        speed_scale (1) [-]: path rate in [0, 1] that is allowed; 0 while ``stop`` is latched.
        stop (1): 1 if the operator's is, or while the hand or the arm is not seen, or was not since the last
            acknowledgement. An ``ack`` that rises while both are seen releases it; one that was high before does not.
        hand_distance (1) [m]: least distance between the arm and hand or forearm; negative if they overlap.
        closing_speed (1) [m/s]: with which the part of the arm that is nearest would come nearer at path rate 1.
        allowed_speed (1) [m/s]: with which it may, by the protective distance alone.

    State:
        [stop latched, ack at the last look].

    Events:
        update: every ``config.period``.

    Args:
        config: validated settings.
        arm: the arm's shape.
        stop_time: [s] of RobotAction.
    """

    def __init__(self, config: SafetyConfig, arm: ArmCapsules, stop_time: float = STOP_TIME) -> None:
        super().__init__()
        self.set_name("safety_monitor")
        self._config, self._arm, self._stop_time = config, arm, stop_time
        self.DeclareDiscreteState(2)
        self._p_WH = declare_input(self, "p_WH", 3)
        self._hand_age = declare_input(self, "hand_age")
        self._measured = declare_input(self, "position_measured", 7)
        self._path_position = declare_input(self, "path_position", 7 * NUM_POSTURES)
        self._path_velocity = declare_input(self, "path_velocity", 7 * NUM_POSTURES)
        self._motion = declare_input(self, "motion_progress", 3)
        self._operator_stop = declare_input(self, "stop")
        self._ack = declare_input(self, "ack")

        def tickets(*ports: InputPort) -> set:
            return {self.input_port_ticket(port.get_index()) for port in ports}

        seen = tickets(self._p_WH, self._measured, self._path_position, self._path_velocity, self._motion)
        stops = tickets(self._p_WH, self._hand_age, self._measured) | {self.xd_ticket()}
        self._found = self.DeclareCacheEntry(
            "separation", ValueProducer(allocate=lambda: Value(BasicVector(3)), calc=self._calc_found), seen
        )
        declare_output(self, "speed_scale", self._speed_scale, seen | stops)
        declare_output(self, "stop", self._stop, stops | tickets(self._operator_stop))
        declare_output(self, "hand_distance", lambda context: self._find(context)[_DISTANCE], seen)
        declare_output(self, "closing_speed", lambda context: self._find(context)[_CLOSING], seen)
        declare_output(self, "allowed_speed", self._allowed_speed, seen)
        self.DeclarePeriodicDiscreteUpdateEvent(config.period, 0.0, self._update)

    def _calc_found(self, context: Context, cache: Value) -> None:
        config = self._config
        positions = self._path_position.Eval(context).reshape(NUM_POSTURES, 7).copy()
        # The arm is where it is measured; only what lies ahead is taken from the plan.
        positions[0] = self._measured.Eval(context)
        velocities = self._path_velocity.Eval(context).reshape(NUM_POSTURES, 7)
        near = approach(self._arm, positions, velocities, limb_segments(self._p_WH.Eval(context)), LIMB_RADII)
        rate = allowed_rate(
            near.distance,
            near.length,
            near.speed,
            near.towards,
            config.human_speed,
            config.reaction_time,
            config.period,
            self._stop_time,
            config.margin,
            config.contact_speed,
            config.stop_distance,
            self._motion.Eval(context)[0] == ActionKind.JOINT,
        )
        i, j = np.unravel_index(np.argmin(near.distance), near.distance.shape)
        cache.get_mutable_value().SetFromVector([rate, near.distance[i, j], near.towards[0, i, j].max()])

    def _find(self, context: Context) -> np.ndarray:
        return self._found.Eval(context).value()

    def _allowed_speed(self, context: Context) -> float:
        config = self._config
        _, distance, closing = self._find(context)
        reaction, deceleration = config.reaction_time + config.period, max(closing, 0.0) / self._stop_time
        return float(allowed_speed(config.human_speed, distance, reaction, deceleration, config.margin))

    def _unseen(self, context: Context) -> bool:
        """Whether the hand or the arm is not seen."""
        age = self._hand_age.Eval(context)[0] if self._hand_age.HasValue(context) else 0.0
        total = float(self._p_WH.Eval(context).sum() + self._measured.Eval(context).sum())
        return not (isfinite(total) and age <= self._config.hand_timeout)

    @staticmethod
    def latched(context: Context) -> bool:
        """Whether the stop has latched; once it has, ``stop`` is on until the operator's ``ack``."""
        return bool(context.get_discrete_state_vector().GetAtIndex(0))

    def _latched(self, context: Context) -> bool:
        return self.latched(context) or self._unseen(context)

    def _speed_scale(self, context: Context) -> float:
        return 0.0 if self._latched(context) else self._find(context)[_RATE]

    def _stop(self, context: Context) -> float:
        operator = self._operator_stop.HasValue(context) and self._operator_stop.Eval(context)[0]
        return float(bool(operator) or self._latched(context))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        latched, ack_before = context.get_discrete_state_vector().value()
        ack = self._ack.Eval(context)[0] if self._ack.HasValue(context) else 0.0
        if self._unseen(context):
            latched = 1.0
        elif ack and not ack_before:
            latched = 0.0
        values.set_value(0, [latched, ack])
