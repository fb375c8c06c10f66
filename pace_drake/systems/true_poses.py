"""TruePoses: where the components are, as only a simulation knows."""

from collections.abc import Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, LeafSystem

from pace_drake.systems.ports import declare_output


class TruePoses(LeafSystem):
    """Stands in for ``ComponentLocator`` where nothing is to be seen wrongly.

    Inputs:
        body_poses: the plant's list of X_WB, by body index.

    Outputs:
        component_poses (7 n): per component qw qx qy qz [-], x y z [m] of X_WO, in the order of ``bodies``.
        component_ages (n) [s]: 0.

    Args:
        bodies: of the components.
    """

    def __init__(self, bodies: Sequence[BodyIndex]) -> None:
        super().__init__()
        self.set_name("true_poses")
        self._bodies = [int(index) for index in bodies]
        self._body_poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())
        poses = {self.input_port_ticket(self._body_poses.get_index())}
        declare_output(self, "component_poses", self._poses, poses, size=7 * len(self._bodies))
        declare_output(self, "component_ages", self._ages, {self.nothing_ticket()}, size=len(self._bodies))

    def _poses(self, context: Context) -> np.ndarray:
        X_WB = self._body_poses.Eval(context)
        components = (X_WB[index] for index in self._bodies)
        return np.concatenate([[*X.rotation().ToQuaternion().wxyz(), *X.translation()] for X in components])

    def _ages(self, context: Context) -> np.ndarray:
        return np.zeros(len(self._bodies))
