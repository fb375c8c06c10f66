"""The Panda's collision capsules, read once from its model."""

from typing import Any

import numpy as np
from pydrake.geometry import Box, Capsule, Role
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from pace_drake.resources import resource_path
from pace_drake.safety.proximity import ArmCapsules
from pace_drake.stations.plant import NUM_ARM_JOINTS


def load_arm_capsules() -> ArmCapsules:
    """Reads ``models/panda.urdf``, its base at the world's origin.

    Capsules are taken as they are. The boxes of both fingers become one capsule that holds them at any width, and all
    between them.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.005)
    (panda,) = Parser(plant).AddModels(str(resource_path("models/panda.urdf")))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("panda_link0"))
    plant.Finalize()
    # Kept until the end: the context refers to it.
    diagram = builder.Build()
    context = plant.GetMyContextFromRoot(diagram.CreateDefaultContext())
    inspector = scene_graph.model_inspector()

    joints = []
    for k in range(1, NUM_ARM_JOINTS + 1):
        frame = plant.GetJointByName(f"panda_joint{k}").frame_on_parent()
        joints.append(frame.GetFixedPoseInBodyFrame().GetAsMatrix34())
    link_frames = [plant.GetFrameByName(f"panda_link{k}") for k in range(NUM_ARM_JOINTS + 1)]
    hand = plant.GetFrameByName("panda_hand")
    fingers = [plant.GetJointByName(f"panda_finger_joint{k}") for k in (1, 2)]
    links: list[int] = []
    segments: list[Any] = []
    radii: list[float] = []
    corners = []
    for index in plant.GetBodyIndices(panda):
        body = plant.get_body(index)
        name = body.name()
        link = int(name[-1]) if name.startswith("panda_link") else NUM_ARM_JOINTS
        for geometry in inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), Role.kProximity):
            shape, X_BG = inspector.GetShape(geometry), inspector.GetPoseInFrame(geometry)
            if isinstance(shape, Capsule):
                X_LG = plant.CalcRelativeTransform(context, link_frames[link], body.body_frame()) @ X_BG
                half = np.array([0.0, 0.0, shape.length() / 2])
                links.append(link)
                segments.append([X_LG @ -half, X_LG @ half])
                radii.append(shape.radius())
            elif isinstance(shape, Box):
                for travel in (fingers[0].position_lower_limit(), fingers[0].position_upper_limit()):
                    for finger in fingers:
                        finger.set_translation(context, travel)
                    X_HG = plant.CalcRelativeTransform(context, hand, body.body_frame()) @ X_BG
                    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
                    corners.append((X_HG @ (signs * shape.size()[:, np.newaxis] / 2)).T)
    # Fingers move along the hand's y axis.
    points = np.concatenate(corners)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    ends = [np.array([middle[0], y, middle[2]]) for y in (low[1], high[1])]
    X_LH = plant.CalcRelativeTransform(context, link_frames[NUM_ARM_JOINTS], hand)
    links.append(NUM_ARM_JOINTS)
    segments.append([X_LH @ end for end in ends])
    radii.append(float(np.hypot(high[0] - middle[0], high[2] - middle[2])))
    return ArmCapsules(np.array(joints), np.array(links), np.array(segments), np.array(radii))
