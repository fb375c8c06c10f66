"""The Panda in the meshes of Drake's model package: a small package stands in for it, made here from our own model."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from pydrake.geometry import Mesh, Role
from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
from pydrake.systems.framework import DiagramBuilder

from pace_drake.errors import InputError
from pace_drake.resources import resource_path
from pace_drake.stations import plant as plant_module
from pace_drake.stations import robot_looks
from pace_drake.stations.plant import add_furniture, make_plant_station
from pace_drake.stations.workcell import Workcell

TRIANGLE = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nvn 0 0 1\nf 1//1 2//1 3//1\n"


@pytest.fixture
def stand_in(tmp_path):
    """A folder like drake_models, in which every link is one triangle; its model as a tree, and where it is written."""
    folder = tmp_path / "drake_models"
    urdf = folder / "franka_description" / "urdf" / "panda_arm_hand.urdf"
    urdf.parent.mkdir(parents=True)
    (folder / "package.xml").write_text("<package><name>drake_models</name></package>")
    (folder / "triangle.obj").write_text(TRIANGLE)
    tree = ET.parse(resource_path("models/panda.urdf"))
    for link in tree.getroot().iter("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
        geometry = ET.SubElement(ET.SubElement(link, "visual"), "geometry")
        ET.SubElement(geometry, "mesh", filename="package://drake_models/triangle.obj")
    tree.write(urdf)
    return folder, tree, urdf


def dressed(folder, workcell=None):
    """Plant and scene graph of the workcell, with the Panda in the meshes of a package."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.005), builder)
    add_furniture(plant, scene_graph, workcell or Workcell())
    robot_looks.wear_drake_models(plant, scene_graph, plant.GetModelInstanceByName("panda"), folder)
    plant.Finalize()
    return builder, plant, scene_graph


def shapes(plant, scene_graph, role):
    """Per link of the Panda, the shapes with a role."""
    inspector = scene_graph.model_inspector()
    found = {}
    for index in plant.GetBodyIndices(plant.GetModelInstanceByName("panda")):
        ids = inspector.GetGeometries(plant.GetBodyFrameIdOrThrow(index), role)
        found[plant.get_body(index).name()] = [inspector.GetShape(one) for one in ids]
    return found


def test_only_looks_change(stand_in):
    _keep, plant, scene_graph = dressed(stand_in[0])
    for role in (Role.kIllustration, Role.kPerception):
        for link, worn in shapes(plant, scene_graph, role).items():
            assert [type(shape) for shape in worn] == [Mesh], link
    bare_builder = DiagramBuilder()
    bare, bare_graph = AddMultibodyPlant(MultibodyPlantConfig(time_step=0.005), bare_builder)
    add_furniture(bare, bare_graph, Workcell())
    bare.Finalize()
    touched = {name: [str(shape) for shape in of] for name, of in shapes(plant, scene_graph, Role.kProximity).items()}
    assert touched == {name: [str(s) for s in of] for name, of in shapes(bare, bare_graph, Role.kProximity).items()}
    assert plant.num_actuators() == bare.num_actuators()
    np.testing.assert_array_equal(plant.GetAccelerationUpperLimits(), bare.GetAccelerationUpperLimits())
    assert plant.HasFrameNamed("panda_hand_tcp")


def test_the_scenario_switches(stand_in, monkeypatch):
    real = robot_looks.wear_drake_models
    monkeypatch.setattr(plant_module, "wear_drake_models", lambda *arguments: real(*arguments, stand_in[0]))
    station = make_plant_station(Workcell(robot_model="drake_models"))
    worn = shapes(station.GetSubsystemByName("plant"), station.GetSubsystemByName("seen_scene"), Role.kIllustration)
    assert {type(shape) for of in worn.values() for shape in of} == {Mesh}


def test_offline_one_line_says_what_to_do(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # where Drake keeps what it has fetched
    for name in ("http_proxy", "https_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")  # nobody listens
    with pytest.raises(InputError, match=r"robot_model: drake_models cannot be had.* use pace_drake") as error:
        make_plant_station(Workcell(robot_model="drake_models"))
    assert "\n" not in str(error.value)


def test_another_arm_is_refused(stand_in):
    folder, tree, urdf = stand_in
    joint = next(j for j in tree.getroot().iter("joint") if j.get("name") == "panda_joint5")
    joint.find("origin").set("xyz", "-0.0825 0.394 0")
    tree.write(urdf)
    with pytest.raises(InputError, match="has panda_joint5 in another place"):
        dressed(folder)
    for element in tree.getroot().iter():
        if element.get("name") == "panda_rightfinger":
            element.set("name", "other_finger")
        if element.get("link") == "panda_rightfinger":
            element.set("link", "other_finger")
    tree.write(urdf)
    with pytest.raises(InputError, match="has no link panda_rightfinger"):
        dressed(folder)


def test_unknown_looks_are_refused():
    with pytest.raises(InputError, match="robot_model: must be one of pace_drake, drake_models, is 'blender'"):
        Workcell(robot_model="blender").validate()
