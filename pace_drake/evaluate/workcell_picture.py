"""A picture of the workcell, rendered without a display."""

from pathlib import Path

import matplotlib.image
import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SsaoParameter,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.sensors import CameraInfo

from pace_drake.stations.plant import make_plant_station
from pace_drake.stations.workcell import Workcell

WORKING_POSE = (-0.62, 0.32, -0.12, -2.05, 0.05, 2.36, 0.10)
"""[rad] over the cubes on the sorting table."""


def render_workcell(
    path: Path | str,
    workcell: Workcell,
    q: np.ndarray,
    *,
    p_WH: tuple[float, float, float] = (0.92, 0.17, 0.27),
    width: int = 1280,
    height: int = 720,
) -> None:
    """Writes a PNG of the workcell.

    Args:
        path: file to write.
        workcell: what stands where.
        q: (7) [rad] joint positions of the arm.
        p_WH: [m] the person's right hand.
        width: [px] of the picture.
        height: [px] of the picture.

    Raises:
        InputError: the workcell or ``q`` cannot be used.
        RuntimeError: VTK finds no EGL library (Debian: ``libegl1``).
    """
    station = make_plant_station(workcell, initial_position=np.asarray(q, dtype=float))
    context = station.CreateDefaultContext()
    station.GetInputPort("p_WH").FixValue(context, np.asarray(p_WH, dtype=float))
    scene_graph = station.GetSubsystemByName("seen_scene")
    engine = MakeRenderEngineVtk(
        RenderEngineVtkParams(
            default_clear_color=[0.86, 0.89, 0.92],
            lights=[
                LightParameter(type="directional", direction=[-0.3, 0.5, -0.9], frame="world", intensity=0.74),
                LightParameter(type="directional", direction=[0.8, 0.5, -0.4], frame="world", intensity=0.18),
                LightParameter(type="directional", direction=[0.0, 0.0, 1.0], frame="camera", intensity=0.42),
            ],
            # Ambient occlusion gives contact shadows; VTK's shadow maps are blotchy at this scale.
            ssao=SsaoParameter(radius=0.12, bias=0.004, sample_count=256),
        )
    )
    scene_graph.AddRenderer(scene_graph.GetMyMutableContextFromRoot(context), "vtk", engine)

    # Twice the size, then averaged: smooth edges.
    core = RenderCameraCore(
        "vtk", CameraInfo(2 * width, 2 * height, fov_y=0.58), ClippingRange(0.1, 20.0), RigidTransform()
    )
    query = station.GetOutputPort("query_object").Eval(context)
    image = query.RenderColorImage(
        ColorRenderCamera(core),
        scene_graph.world_frame_id(),
        _look_at(np.array([1.19, -3.05, 1.20]), np.array([0.70, 0.0, 0.07])),
    )
    pixels = np.asarray(image.data)[:, :, :3].astype(float)
    pixels = pixels.reshape(height, 2, width, 2, 3).mean(axis=(1, 3))
    matplotlib.image.imsave(path, pixels.round().astype(np.uint8))


def _look_at(p_WC: np.ndarray, p_WTarget: np.ndarray) -> RigidTransform:
    """X_WC of a camera (z forward, y down) at p_WC that looks at p_WTarget."""
    z = (p_WTarget - p_WC) / np.linalg.norm(p_WTarget - p_WC)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RigidTransform(RotationMatrix(np.column_stack([x, np.cross(z, x), z])), p_WC)
