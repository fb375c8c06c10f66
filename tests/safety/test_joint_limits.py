"""What gate and driver keep is what the motions are planned within."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from pace_drake.resources import resource_path
from pace_drake.safety.joint_limits import JOINT_LIMITS


@pytest.mark.parametrize("field", ["lower", "upper", "velocity", "acceleration"])
def test_the_fers_limits_are_those_of_its_model(field):
    root = ET.parse(resource_path("models/panda.urdf")).getroot()
    limits = [joint.find("limit") for joint in root.iter("joint") if joint.get("type") == "revolute"]
    found = [
        next(float(value) for name, value in limit.attrib.items() if name.split("}")[-1].split(":")[-1] == field)
        for limit in limits
    ]
    np.testing.assert_array_equal(JOINT_LIMITS["fer"].__dict__[field], found)
