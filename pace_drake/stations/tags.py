"""Which AprilTag is where on which component, and the labels that show them."""

from collections.abc import Iterable

from pydrake.common import MemoryFile
from pydrake.geometry import GeometryInstance, IllustrationProperties, InMemoryMesh, Mesh, PerceptionProperties
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant

from pace_drake.errors import InputError
from pace_drake.perception import Tag
from pace_drake.resources import resource_path

#: [m] of a label, so that a tag is not in, but on what it marks.
_LABEL = 0.0003


def _tag(id: int, x: float, y: float, top: float, size: float) -> Tag:
    return Tag(id, (x, y, top + _LABEL), size)


#: Component -> its tags; a label (1.25 times the tag) must fit on the face that it is on. Faces are those of the files
#: in models/, sizes and places in [m].
TAGS: dict[str, tuple[Tag, ...]] = {
    **{f"cube_{k + 1}": (_tag(k, 0.0, 0.0, 0.02, 0.030),) for k in range(8)},
    # On the legs: the seat rail between them is where the gripper takes the side.
    "chair_side": (
        _tag(8, 0.11, 0.18, 0.025, 0.028),
        _tag(9, 0.11, -0.18, 0.025, 0.028),
        _tag(10, -0.11, 0.18, 0.025, 0.028),
        _tag(11, -0.11, -0.18, 0.025, 0.028),
    ),
    **{f"allen_key_{k + 1}": (_tag(12 + k, 0.025, 0.0, 0.022, 0.019),) for k in range(4)},
}


def tags_of(names: Iterable[str]) -> dict[str, tuple[Tag, ...]]:
    """The tags of these components.

    Raises:
        InputError: one of them carries none.
    """
    names = tuple(names)
    for name in names:
        if name not in TAGS:
            raise InputError(f"{name}: carries no tag, cameras cannot find it; use fewer, or perception=true_poses")
    return {name: TAGS[name] for name in names}


def add_tags(plant: MultibodyPlant, names: Iterable[str]) -> None:
    """Shows tags on the components that have some: for eyes and cameras, nothing touches them.

    Args:
        plant: with a SceneGraph, not yet finalized.
        names: model instances of one body.
    """
    for name in names:
        (index,) = plant.GetBodyIndices(plant.GetModelInstanceByName(name))
        for tag in TAGS.get(name, ()):
            X_OT = RigidTransform(RollPitchYaw(0.0, 0.0, tag.yaw), tag.p_OT)
            label = GeometryInstance(X_OT, _label(tag), f"tag_{tag.id}")
            label.set_illustration_properties(IllustrationProperties())
            label.set_perception_properties(PerceptionProperties())
            plant.RegisterVisualGeometry(plant.get_body(index), label)


def _label(tag: Tag) -> Mesh:
    """A square with the tag's picture on it, white margin included."""
    h = 1.25 * tag.size / 2
    corners = ((-h, -h), (h, -h), (h, h), (-h, h))
    lines = [
        "mtllib label.mtl",
        *(f"v {x} {y} 0" for x, y in corners),
        *("vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1", "vn 0 0 1"),
        "usemtl label",
        "f 1/1/1 2/2/1 3/3/1 4/4/1",
    ]
    material = "newmtl label\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nmap_Kd tag.png\n"
    picture = resource_path(f"models/tags/tag36h11_{tag.id:02d}.png")
    return Mesh(
        InMemoryMesh(
            mesh_file=MemoryFile("\n".join(lines) + "\n", ".obj", f"label_{tag.id}.obj"),
            supporting_files={
                "label.mtl": MemoryFile(material, ".mtl", "label.mtl"),
                "tag.png": MemoryFile(picture.read_bytes(), ".png", picture.name),
            },
        )
    )
