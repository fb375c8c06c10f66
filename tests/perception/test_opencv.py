"""OpenCV is not needed until pictures are looked at; then it is said what to install."""

import sys

import pytest

from pace_drake.errors import InputError
from pace_drake.perception import ComponentDetector


def test_without_opencv_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(InputError, match=r"pip install 'pace_drake\[perception\]'"):
        ComponentDetector({})
