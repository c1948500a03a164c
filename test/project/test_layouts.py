"""The layouts for PlotJuggler and Foxglove name topics, fields and elements that exist."""

from __future__ import annotations

import json
import re
from typing import Any
from xml.etree import ElementTree

import yaml
from support.places import ROBOT, ROOT

from cdrj_ros.evaluation.answers import ANSWER_TOPICS
from cdrj_ros.messages.cdr import JOINT_STATE
from cdrj_ros.model.loading import load_model
from cdrj_ros.robot.description import Robot

FOLDER = ROOT / "config" / "layouts"
LAYOUT = load_model(ROBOT).layout
AXES = (*LAYOUT.motors, *LAYOUT.joints)
MESSAGES = {f"/cdrj/{topic.name}": topic.message for topic in ANSWER_TOPICS}
MESSAGES["/cdrj/tension_states"] = JOINT_STATE
NAMES = {
    "/cdrj/tensions": LAYOUT.elements,
    "/cdrj/nodal_forces": LAYOUT.pulleys,
    "/cdrj/efforts": AXES,
    "/cdrj/tension_states": LAYOUT.elements,
}


def published() -> set[str]:
    """Topics that the estimator may publish, from its security policy."""
    policy = ElementTree.parse(ROOT / "config" / "sros2" / "cdrj_ros.policy.xml")
    (estimator,) = policy.iterfind(".//profile[@node='estimator']")
    topics = estimator.findall("topics[@publish='ALLOW']/topic")
    return {t.text if t.text.startswith("/") else f"/cdrj/{t.text}" for t in topics if t.text}


def element_shown(topic: str, field: str, index: str) -> str:
    """Name of the element of an array entry; topic, field and index must exist."""
    assert topic in published(), topic
    numbers = {one.name for one in MESSAGES[topic].fields if one.count == 0 and one.name != "name"}
    assert field in numbers, f"{topic} has no {field}"
    return str(NAMES[topic][int(index)])


def curve_of_plotjuggler(name: str) -> str:
    """Element shown by a PlotJuggler curve: an array entry, or the effort of an entry by name."""
    if match := re.fullmatch(r"(/cdrj/\w+)/(\w+)\[(\d+)\]", name):
        return element_shown(*match.groups())
    match = re.fullmatch(r"(/cdrj/\w+)/([\w/]+)/(\w+)", name)
    assert match, name
    topic, entry, field = match.groups()
    assert MESSAGES[topic] is JOINT_STATE
    return element_shown(topic, field, str(NAMES[topic].index(entry)))


def curve_of_foxglove(path: str) -> str:
    """Element shown by a Foxglove message path."""
    match = re.fullmatch(r"(/cdrj/\w+)\.(\w+)\[(\d+)\]", path)
    assert match, path
    return element_shown(*match.groups())


def panels_of(tree: Any) -> list[str]:
    return [tree] if isinstance(tree, str) else panels_of(tree["first"]) + panels_of(tree["second"])


def test_plotjuggler_finds_every_curve() -> None:
    root = ElementTree.parse(FOLDER / "plotjuggler_prototype.xml").getroot()
    shown = [curve_of_plotjuggler(curve.attrib["name"]) for curve in root.iter("curve")]
    assert set(shown) == {*LAYOUT.elements, *LAYOUT.pulleys, *AXES}
    topics = root.find("Plugins/plugin/selected_topics")
    assert topics is not None
    assert set(topics.attrib["value"].split(";")) == set(MESSAGES)


def test_foxglove_finds_every_path_and_its_labels_are_correct() -> None:
    document = json.loads((FOLDER / "foxglove_prototype.json").read_text())
    panels = document["configById"]
    assert sorted(panels_of(document["layout"])) == sorted(panels)
    labels = set()
    for name, panel in panels.items():
        if name.startswith("Plot!"):
            for path in panel["paths"]:
                assert curve_of_foxglove(path["value"]) == path["label"]
                labels.add(path["label"])
        else:
            assert name.startswith("DiagnosticStatusPanel!")
            assert panel["topicToRender"] in published()
    assert labels == {*LAYOUT.elements, *AXES}


def test_rviz_shows_the_markers_in_their_default_frame() -> None:
    layout = yaml.safe_load((FOLDER / "markers.rviz").read_text())
    (cables,) = (
        one
        for one in layout["Visualization Manager"]["Displays"]
        if one["Class"] == "rviz_default_plugins/MarkerArray"
    )
    policy = ElementTree.parse(ROOT / "config" / "sros2" / "cdrj_ros.policy.xml")
    topics = policy.findall(".//profile[@node='markers']/topics[@publish='ALLOW']/topic")
    assert cables["Topic"]["Value"] in {f"/cdrj/{topic.text}" for topic in topics}
    frame = layout["Visualization Manager"]["Global Options"]["Fixed Frame"]
    assert frame == Robot.base_link
