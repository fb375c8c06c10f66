"""OpenCV, imported only where pictures are looked at: the extra ``perception``."""

from types import ModuleType

from pace_drake.errors import InputError


def import_opencv() -> ModuleType:
    """Returns the module ``cv2``.

    Raises:
        InputError: it is not installed, or lacks the detector.
    """
    try:
        import cv2
    except ImportError as error:
        raise InputError(f"finding tags needs OpenCV ({error}): pip install 'pace_drake[perception]'") from None
    if not hasattr(cv2, "aruco"):
        raise InputError(f"OpenCV {cv2.__version__} has no aruco module: pip install 'opencv-python-headless>=4.10'")
    return cv2
