"""The components on their tables, placed anew as often as one likes, and cameras over them."""

from collections.abc import Mapping

import numpy as np
from pydrake.geometry import Box
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import RigidBody, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from pace_drake.perception import UprightPose
from pace_drake.stations.camera import add_cameras
from pace_drake.stations.components import components
from pace_drake.stations.plant import add_components, add_furniture
from pace_drake.stations.workcell import Camera, Workcell

#: [m] edges of the plates that hide a single tag, or all of the chair's side.
_COVERS = {"small_cover": (0.08, 0.08, 0.004), "large_cover": (0.44, 0.36, 0.004)}
_COVER_HEIGHT = 0.06  # [m] over the table
_AWAY = RigidTransform([0.0, 0.0, -5.0])


class TaggedScene:
    """Tables, arm and components; nothing moves but what is placed.

    Args:
        workcell: which components there are, and where the arm is.
        cameras: by any names.

    Raises:
        InputError: this machine cannot render.
    """

    def __init__(self, workcell: Workcell, cameras: Mapping[str, Camera]) -> None:
        builder = DiagramBuilder()
        # Discrete, as the second finger's mimic joint asks for.
        self._plant, scene_graph = AddMultibodyPlantSceneGraph(builder, workcell.time_step)
        add_components(self._plant, scene_graph, workcell, add_furniture(self._plant, scene_graph, workcell))
        self._bodies: dict[str, RigidBody] = {
            component.name: self._plant.GetBodyByName(
                component.model, self._plant.GetModelInstanceByName(component.name)
            )
            for component in components(workcell)
        }
        for name, size in _COVERS.items():
            self._bodies[name] = self._plant.AddRigidBody(
                name, self._plant.AddModelInstance(name), SpatialInertia.SolidBoxWithMass(1.0, *size)
            )
            grey = np.array([0.3, 0.3, 0.3, 1.0])
            self._plant.RegisterVisualGeometry(self._bodies[name], RigidTransform(), Box(*size), name, grey)
        self._plant.Finalize()
        add_cameras(builder, scene_graph, cameras)
        self._diagram = builder.Build()
        self._context = self._diagram.CreateDefaultContext()
        self._plant_context = self._plant.GetMyMutableContextFromRoot(self._context)
        arm = self._plant.GetModelInstanceByName("panda")
        self._plant.SetPositions(self._plant_context, arm, [*workcell.home, 0.0, 0.0])
        self.uncover()

    def place(self, poses: Mapping[str, UprightPose]) -> None:
        """Puts components where they are said to be."""
        for name, pose in poses.items():
            X_WO = RigidTransform(RollPitchYaw(0.0, 0.0, pose.yaw), pose.p_WO)
            self._plant.SetFreeBodyPose(self._plant_context, self._bodies[name], X_WO)

    def cover(self, name: str, pose: UprightPose, offset: float) -> None:
        """Puts a plate over a component.

        Args:
            name: of the component.
            pose: where it is.
            offset: [m] of the plate's middle from the component's tags, along the component's x axis.
        """
        cover = "large_cover" if name == "chair_side" else "small_cover"
        over = 0.0 if not name.startswith("allen_key") else 0.025
        p_W = pose.to_world(np.array([[over + offset, 0.0, 0.0]]))[0]
        X_WC = RigidTransform(RollPitchYaw(0.0, 0.0, pose.yaw + (np.pi / 2 if cover == "large_cover" else 0.0)), p_W)
        X_WC.set_translation([p_W[0], p_W[1], _COVER_HEIGHT])
        self._plant.SetFreeBodyPose(self._plant_context, self._bodies[cover], X_WC)

    def uncover(self) -> None:
        """Takes the plates away."""
        for cover in _COVERS:
            self._plant.SetFreeBodyPose(self._plant_context, self._bodies[cover], _AWAY)

    def look(self, camera: str) -> tuple[np.ndarray, np.ndarray]:
        """The colour (height, width, 4) and depth (height, width) [m] pictures of a camera."""
        color, depth = (
            self._diagram.GetOutputPort(f"{camera}.{kind}").Eval(self._context).data
            for kind in ("color_image", "depth_image")
        )
        return color.copy(), depth[:, :, 0].copy()
