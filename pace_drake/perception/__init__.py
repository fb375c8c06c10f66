"""Where things are, seen by a colour and depth camera: AprilTags found by OpenCV. No Drake in here."""

from pace_drake.perception.camera import PinholeCamera
from pace_drake.perception.component_detector import ComponentDetector
from pace_drake.perception.tag import Tag
from pace_drake.perception.upright_pose import UprightPose

__all__ = ["ComponentDetector", "PinholeCamera", "Tag", "UprightPose"]
