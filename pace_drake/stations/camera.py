"""The cameras over the tables, as Drake simulates them."""

from collections.abc import Mapping

from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from pace_drake.errors import InputError
from pace_drake.perception import PinholeCamera
from pace_drake.stations.workcell import Camera

_RENDERER = "cameras"
_CLIPPING = ClippingRange(0.05, 5.0)  # [m]
_DEPTH = DepthRange(0.1, 3.0)  # [m]
_LIGHTS = [
    LightParameter(type="directional", direction=[-0.3, 0.5, -0.9], frame="world", intensity=0.8),
    LightParameter(type="directional", direction=[0.8, 0.5, -0.4], frame="world", intensity=0.25),
]


def pinhole_camera(camera: Camera) -> PinholeCamera:
    """What the detector must know of a camera."""
    return PinholeCamera(_info(camera).intrinsic_matrix(), camera.pose.to_rigid_transform().GetAsMatrix4())


def add_cameras(builder: DiagramBuilder, scene: SceneGraph, cameras: Mapping[str, Camera]) -> None:
    """Adds colour and depth cameras, and exports their pictures.

    The scene should not be the one that a plant's contacts are found in: a renderer in it would follow every step of
    the plant, which then takes three times as long.

    Outputs:
        NAME.color_image: ImageRgba8U.
        NAME.depth_image: ImageDepth32F [m]; 0 nearer and inf farther than the camera measures. Both are rendered only
            when somebody asks for them, and then once an instant.

    Args:
        builder: holds ``scene``.
        scene: what they look at.
        cameras: by name; those that are not enabled are left out.

    Raises:
        InputError: this machine cannot render.
    """
    try:
        engine = MakeRenderEngineVtk(RenderEngineVtkParams(default_clear_color=[0.5, 0.5, 0.5], lights=_LIGHTS))
    except RuntimeError as error:
        raise InputError(
            f"cameras need OpenGL without a display ({error}): apt-get install libegl1, or use perception=true_poses"
        ) from None
    scene.AddRenderer(_RENDERER, engine)
    for name, camera in cameras.items():
        if not camera.enabled:
            continue
        core = RenderCameraCore(_RENDERER, _info(camera), _CLIPPING, RigidTransform())
        sensor = RgbdSensor(
            scene.world_frame_id(),
            camera.pose.to_rigid_transform(),
            ColorRenderCamera(core),
            DepthRenderCamera(core, _DEPTH),
        )
        builder.AddNamedSystem(name, sensor)
        builder.Connect(scene.get_query_output_port(), sensor.query_object_input_port())
        builder.ExportOutput(sensor.color_image_output_port(), f"{name}.color_image")
        builder.ExportOutput(sensor.depth_image_32F_output_port(), f"{name}.depth_image")


def _info(camera: Camera) -> CameraInfo:
    return CameraInfo(camera.width, camera.height, fov_y=camera.fov_y)
