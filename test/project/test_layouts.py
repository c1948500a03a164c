"""The layouts for PlotJuggler, Foxglove and RViz name topics, fields and elements that exist."""

import re
from xml.etree import ElementTree

import yaml
from support.places import ROBOT, ROOT

from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES
from cdrj_ros.model.prepared import load_model
from cdrj_ros.robot.description import Robot

FOLDER = ROOT / "config" / "layouts"
POLICY = ElementTree.parse(ROOT / "config" / "sros2" / "cdrj_ros.policy.xml")
LAYOUT = load_model(ROBOT).layout


def published(node):
    """Topics that a node may publish, from its security policy."""
    topics = POLICY.findall(f".//profile[@node='{node}']/topics[@publish='ALLOW']/topic")
    return {t.text if t.text.startswith("/") else f"/cdrj/{t.text}" for t in topics if t.text}


def test_the_layouts_of_curves_show_topics_that_are_published():
    for name in ("plotjuggler_prototype.xml", "foxglove_prototype.json"):
        topics = {*re.findall(r"/cdrj/\w+", (FOLDER / name).read_text())}
        assert len(topics) > 1
        assert topics <= published("estimator")


def test_the_curves_of_plotjuggler_are_numbers_and_names_of_the_messages():
    curves = ElementTree.parse(FOLDER / "plotjuggler_prototype.xml").findall(".//curve")
    shown = {curve.attrib["name"] for curve in curves}
    wanted = {f"/cdrj/efforts/{name}/effort" for name in LAYOUT.motors + LAYOUT.joints}
    wanted |= {f"/cdrj/tension_states/{name}/effort" for name in LAYOUT.elements}
    for topic, names, message, fields in (
        ("tensions", LAYOUT.elements, CABLE_TENSIONS, ("tension", "stddev", "status")),
        ("nodal_forces", LAYOUT.pulleys, NODAL_FORCES, ("magnitude", "friction")),
    ):
        assert {field.name for field in message.fields} >= set(fields)
        wanted |= {f"/cdrj/{topic}/{field}[{k}]" for field in fields for k in range(len(names))}
    assert shown == wanted


def test_a_label_of_foxglove_is_the_name_of_the_entry_that_its_path_shows():
    text = (FOLDER / "foxglove_prototype.json").read_text()
    path = r'"value": "/cdrj/(\w+)\.(\w+)\[(\d+)\]",\s*"label": "(.*?)"'
    of = {"tensions": (LAYOUT.elements, CABLE_TENSIONS),
          "efforts": (LAYOUT.motors + LAYOUT.joints, JOINT_STATE)}  # fmt: skip
    shown = set()
    for topic, array, index, label in re.findall(path, text):
        names, message = of[topic]
        assert names[int(index)] == label
        assert array in {field.name for field in message.fields}
        shown.add(label)
    assert shown == {name for names, _ in of.values() for name in names}


def test_rviz_shows_the_markers_in_their_default_frame():
    shown = yaml.safe_load((FOLDER / "markers.rviz").read_text())["Visualization Manager"]
    (cables,) = (one for one in shown["Displays"] if one["Class"].endswith("/MarkerArray"))
    assert cables["Topic"]["Value"] in published("markers")
    assert shown["Global Options"]["Fixed Frame"] == Robot.base_link
