"""The records of the core have the fields of the arrays that Python makes, in the same order."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from cdrj_ros.model import cable_records, geometry, packing

CORE = Path(packing.__file__).parents[1] / "core"
WORDS = {"Vector3": 3, "Matrix3": 9, "std::array<double, CAPACITY>": cable_records.CAPACITY}

RECORDS: dict[str, Any] = {
    "CableTopology": packing.CABLE_PLAN,
    "EndTopology": packing.END_PLAN,
    "PulleyTopology": packing.PULLEY_PLAN,
    "TermTopology": packing.TERM_PLAN,
    "FrameTopology": geometry.FRAME_PLAN,
    "NodeTopology": geometry.NODE_PLAN,
    "CableConstants": packing.CABLE,
    "EndConstants": packing.END,
    "PulleyConstants": cable_records.PULLEY,
    "ElementConstants": packing.ELEMENT,
    "SegmentConstants": packing.SEGMENT_NUMBERS,
    "FrameConstants": geometry.FRAME,
    "NodeConstants": geometry.NODE,
    "MotorConstants": packing.MOTOR,
    "JointConstants": packing.JOINT,
    "AxisConstants": packing.AXIS,
    "Cubic": geometry.CUBIC,
    "Drum": cable_records.DRUM,
    "ArcMiddle": geometry.ARC_MIDDLE,
    "Segment": cable_records.SEGMENT,
    "Contact": cable_records.CONTACT,
    "Pose": geometry.POSE,
    "Twist": geometry.TWIST,
    "Touch": geometry.TOUCH,
}


def declared() -> dict[str, list[tuple[str, int]]]:
    """Fields of every record and how many words each has."""
    text = "".join((CORE / name).read_text() for name in ("robot_records.hpp", "state_records.hpp"))
    text = re.sub(r"//[^\n]*", "", text)
    found = {}
    for name, body in re.findall(r"struct (\w+) \{(.*?)\n\};", text, flags=re.DOTALL):
        fields = re.findall(r"^\s*([\w:<>, ]+?) (\w+);", body, flags=re.MULTILINE)
        found[name] = [(field, WORDS.get(kind, 1)) for kind, field in fields]
    return found


def test_every_record_of_the_core_is_an_array_of_the_model() -> None:
    assert declared().keys() == RECORDS.keys()


@pytest.mark.parametrize("name", RECORDS)
def test_a_record_of_the_core_has_the_fields_of_the_array(name: str) -> None:
    record = RECORDS[name]
    fields = [(field, record[field].itemsize // 8) for field in record.names]
    assert declared()[name] == fields
