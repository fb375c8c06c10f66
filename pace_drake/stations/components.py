"""What the robot takes: the components' names, and which one an action is about."""

from pace_drake.stations.workcell import Workcell
from pace_drake.task import ActionKind

CHAIR_SIDE = "chair_side"


def component_names(workcell: Workcell) -> tuple[str, ...]:
    """Names of the components' model instances: cube_1, ..., chair_side, allen_key_1, ...; poses have this order."""
    cubes = (f"cube_{k + 1}" for k in range(len(workcell.cubes)))
    keys = (f"allen_key_{k + 1}" for k in range(len(workcell.allen_keys)))
    return (*cubes, CHAIR_SIDE, *keys)


def component_of(workcell: Workcell, kind: ActionKind, index: int) -> str | None:
    """The component that an action looks for before it moves; None if it looks for none.

    Args:
        workcell: how many cubes and keys there are.
        kind: of the action.
        index: 1-based. Robot task i takes cube i, cyclically; the first joint action is about the chair's side, the
            others about Allen keys, cyclically.
    """
    if kind == ActionKind.ROBOT_TASK:
        return f"cube_{(index - 1) % len(workcell.cubes) + 1}"
    if kind == ActionKind.PREPARE:
        return CHAIR_SIDE if index == 1 else f"allen_key_{(index - 2) % len(workcell.allen_keys) + 1}"
    return None


def camera_of(component: str) -> str:
    """The camera over the table on which a component lies."""
    return "sorting_camera" if component.startswith("cube_") else "warehouse_camera"
