"""Where the models, scenarios, statecharts and policies that travel with the package are found."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def resource_path(relative: str) -> Path:
    """Returns the path of a file or folder shipped with the project.

    A wheel holds ``models/``, ``scenarios/`` and ``statecharts/`` inside the package; a checkout holds them
    beside it.

    Args:
        relative: path below the top of the project, such as ``"scenarios/ikea_chair.yaml"``.

    Raises:
        FileNotFoundError: neither place has it.
    """
    for root in (_PACKAGE, _PACKAGE.parent):
        path = root / relative
        if path.exists():
            return path
    raise FileNotFoundError(f"{relative} is not part of this installation of pace_drake")
