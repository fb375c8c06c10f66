"""ComponentLocator: where the components are, as cameras saw them last."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, DiscreteValues, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageRgba8U

from pace_drake.perception import UprightPose
from pace_drake.ports import declare_input, declare_output, declare_update
from pace_drake.task import ActionKind

#: Looks at a colour picture (height, width, 4) and a depth picture (height, width) [m]: poses by component; one that
#: is not in the result was not seen. A pure function.
Look = Callable[[np.ndarray, np.ndarray], Mapping[str, UprightPose]]

#: Places in the state; times seen and poses follow.
_SEQUENCE, _NEXT_LOOK, _SEEN = range(3)


@dataclass(frozen=True)
class Wanted:
    """What an action looks for before it moves."""

    component: str
    camera: str


class ComponentLocator(LeafSystem):
    """Looks for a component when an action is commanded that needs it, and again until it is seen.

    It looks with the camera over that component's table alone, so nothing is rendered in between. Of all components in
    that picture the pose is taken; what is not seen keeps the pose that it had, whose age grows.

    Inputs:
        robot_action (3): kind, index, sequence number.
        NAME.color_image (ImageRgba8U), NAME.depth_image (ImageDepth32F [m]): of each camera; read only at a look.

    Outputs:
        component_poses (7 n): per component qw qx qy qz [-], x y z [m] of X_WO, in the order of ``components``;
            the identity for one that was never seen.
        component_ages (n) [s]: how long ago each was seen; inf if never.
        next_event_time (1) [s]: of the next look, inf if nothing is looked for.

    State:
        [sequence number looked for last, time of the next look [s] (inf: none), times at which each component was seen
        (n) [s] (-inf: never), poses (7 n)].

    Events:
        update: looks, at a new command or when the time of the next look has come (forced or periodic).

    Args:
        components: names, in the order of the outputs.
        looks: how the pictures of each camera are looked at, by the camera's name.
        wanted: what an action (kind, index) looks for; None if nothing.
        retry: [s] > 0 after which it looks again for what it did not see.
        reaction_period: see ``declare_update``.
    """

    def __init__(
        self,
        components: Sequence[str],
        looks: Mapping[str, Look],
        wanted: Callable[[ActionKind, int], Wanted | None],
        retry: float = 0.5,
        reaction_period: float | None = None,
    ) -> None:
        super().__init__()
        self.set_name("component_locator")
        self._components, self._looks, self._wanted, self._retry = tuple(components), dict(looks), wanted, retry
        n = len(self._components)
        nowhere = np.tile([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], n)
        self.DeclareDiscreteState(np.concatenate([[0.0, np.inf], np.full(n, -np.inf), nowhere]))
        self._command = declare_input(self, "robot_action", 3)
        self._images = {
            camera: (
                self.DeclareAbstractInputPort(f"{camera}.color_image", Value(ImageRgba8U())),
                self.DeclareAbstractInputPort(f"{camera}.depth_image", Value(ImageDepth32F())),
            )
            for camera in self._looks
        }
        state = {self.xd_ticket()}
        declare_output(self, "component_poses", self._poses, state, size=7 * n)
        declare_output(self, "component_ages", self._ages, {*state, self.time_ticket()}, size=n)
        declare_output(self, "next_event_time", self._next_event_time, state)
        declare_update(self, self._update, reaction_period)

    # ---- outputs

    @staticmethod
    def _state(context: Context) -> np.ndarray:
        return context.get_discrete_state_vector().value()

    def _poses(self, context: Context) -> np.ndarray:
        return self._state(context)[_SEEN + len(self._components) :]

    def _ages(self, context: Context) -> np.ndarray:
        return context.get_time() - self._state(context)[_SEEN : _SEEN + len(self._components)]

    def _next_event_time(self, context: Context) -> float:
        return self._state(context)[_NEXT_LOOK]

    # ---- update

    def _update(self, context: Context, values: DiscreteValues) -> None:
        kind, index, sequence = self._command.Eval(context)
        time = context.get_time()
        x = values.get_mutable_value(0)
        wanted = self._wanted(ActionKind(int(kind)), int(index))
        if wanted is None:
            x[_NEXT_LOOK] = np.inf
            return
        if sequence == x[_SEQUENCE] and time < x[_NEXT_LOOK]:
            return
        color, depth = (port.Eval(context).data for port in self._images[wanted.camera])
        seen = self._looks[wanted.camera](color, depth[:, :, 0])
        n = len(self._components)
        for k, name in enumerate(self._components):
            if name in seen:
                x[_SEEN + k] = time
                x[_SEEN + n + 7 * k : _SEEN + n + 7 * (k + 1)] = seen[name].wxyz_xyz()
        x[_SEQUENCE] = sequence
        x[_NEXT_LOOK] = np.inf if wanted.component in seen else time + self._retry
