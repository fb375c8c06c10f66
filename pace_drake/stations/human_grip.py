"""HumanGrip: the person's hand takes what the robot holds out, and keeps it."""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

#: [s] between looks at whether the hand is at a key.
_PERIOD = 0.01
# Of the grip. The forces are explicit, so they must be soft against a key, which turns easily about its long axis
# (1.4e-5 kg m^2), and the plant's step of 5 ms.
_STIFFNESS = 40.0  # [N/m]
_DAMPING = 1.5  # [N s/m]
_TURN_DAMPING = 1e-3  # [N m s]
_MAX_FORCE = 2.0  # [N]
_GRAVITY = 9.81  # [m/s^2]


class HumanGrip(LeafSystem):
    """Forces of the person's right hand on Allen keys, which it takes by the short end and never gives back.

    A key is taken when the right hand comes within ``reach`` of its short end while it is held up. The hand then pulls
    the end to itself with a spring and a damper, and bears the key's weight; whoever else holds the key feels it. Two
    keys are held in one hand. It is forces only: the hand's shape pushes nothing.

    Inputs:
        p_WH (3) [m]: the right hand.
        key_<k> (13): state of the k-th key: quaternion w, x, y, z, position [m], angular [rad/s] and translational
            velocity [m/s].

    Outputs:
        applied_spatial_force: list of ExternallyAppliedSpatialForce, for the plant.
        key_taken (number of keys): the order in which keys were taken, from 1; 0 while they are not.

    State:
        that of key_taken.

    Events:
        Update, every 10 ms.

    Args:
        bodies: of the keys.
        reach: [m]
        held_up: [m] least height of a key that is held out.
    """

    p_OEnd = np.array([-0.06, 0.02, 0.006])
    """[m] middle of the short arm, in the key's frame (models/allen_key.sdf)."""

    def __init__(self, bodies: list[RigidBody], reach: float, held_up: float = 0.1) -> None:
        super().__init__()
        self.set_name("human_grip")
        self._bodies, self._reach, self._held_up = bodies, reach, held_up
        self._weights = [body.default_mass() * _GRAVITY for body in bodies]
        self._p_OEnd = self.p_OEnd.tolist()
        self._p_WH = self.DeclareVectorInputPort("p_WH", BasicVector(3))
        self._keys = [self.DeclareVectorInputPort(f"key_{k + 1}", BasicVector(13)) for k in range(len(bodies))]
        self.DeclareDiscreteState(len(bodies))
        self.DeclareAbstractOutputPort(
            "applied_spatial_force", lambda: AbstractValue.Make([ExternallyAppliedSpatialForce()]), self.CalcForce
        )
        self.DeclareVectorOutputPort(
            "key_taken",
            BasicVector(len(bodies)),
            lambda context, output: output.SetFromVector(self._taken(context)),
            {self.xd_ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(_PERIOD, 0.0, self.Update)

    @staticmethod
    def _taken(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _end(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of a key in this state: p_WEnd [m], and the end's velocity [m/s]."""
        # By components: numpy takes ten times as long over so few numbers, and this is done at every step.
        w, x, y, z, px, py, pz, wx, wy, wz, vx, vy, vz = state.tolist()
        ox, oy, oz = self._p_OEnd
        # p_OEnd_W = p + 2 w (u x p) + 2 u x (u x p), u the quaternion's vector part; a plant's quaternions are not
        # normalised, and grow while a body turns.
        s = 2.0 / (w * w + x * x + y * y + z * z)
        ux, uy, uz = y * oz - z * oy, z * ox - x * oz, x * oy - y * ox
        ox += s * (w * ux + y * uz - z * uy)
        oy += s * (w * uy + z * ux - x * uz)
        oz += s * (w * uz + x * uy - y * ux)
        return (
            np.array([px + ox, py + oy, pz + oz]),
            np.array([vx + wy * oz - wz * oy, vy + wz * ox - wx * oz, vz + wx * oy - wy * ox]),
        )

    def Update(self, context: Context, values: DiscreteValues) -> None:
        """Takes a key that is at hand."""
        taken = self._taken(context)
        for k in np.flatnonzero(taken == 0):
            state = self._keys[k].Eval(context)
            if state[6] < self._held_up:
                continue
            p_WEnd, _ = self._end(state)
            if np.linalg.norm(self._p_WH.Eval(context) - p_WEnd) < self._reach:
                values.get_mutable_vector().SetAtIndex(int(k), taken.max() + 1.0)

    def CalcForce(self, context: Context, output: Value) -> None:
        """Spring, damper and weight at the short end of each key that was taken."""
        taken = self._taken(context)
        forces = []
        for k in np.flatnonzero(taken):
            p_WH = self._p_WH.Eval(context)
            state = self._keys[k].Eval(context)
            p_WEnd, v_WEnd = self._end(state)
            pull = _STIFFNESS * (p_WH - p_WEnd)
            pull *= min(1.0, _MAX_FORCE / max(float(np.linalg.norm(pull)), 1e-9))
            force = ExternallyAppliedSpatialForce()
            force.body_index = self._bodies[k].index()
            force.p_BoBq_B = self.p_OEnd
            force.F_Bq_W = SpatialForce(
                tau=-_TURN_DAMPING * state[7:10],
                f=pull - _DAMPING * v_WEnd + [0.0, 0.0, self._weights[k]],
            )
            forces.append(force)
        output.set_value(forces)
