"""What tests of cameras need from the machine."""

import ctypes

import pytest


def require_rendering() -> None:
    """Skips where Drake cannot render without a display."""
    try:
        ctypes.CDLL("libEGL.so.1")
    except OSError as error:
        pytest.skip(f"cameras need EGL ({error}): apt-get install libegl1")


def require_opencv():
    """Skips where OpenCV is not installed."""
    return pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'pace_drake[perception]'")
