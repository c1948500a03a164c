"""Message definitions embedded in bags."""

import pytest

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.messages.cdr import JOINT_STATE, TEXT, Field
from cdrj_ros.recordings.definitions import (
    long_name,
    message_type,
    own_definition,
    parse_definition,
)


def test_nested_messages_are_flattened():
    text = (
        '# a comment\nHeader header  # another\nuint8 OK=0\nstring WORD = "a = b"\n'
        "Pair pair\nfloat32[3] fixed\nint16[<=4] bounded\nstring<=8[] words\nfloat64 half 0.5\n"
        "================\nMSG: made_up/Pair\nbool first\nother/Time when\n"
        "===\nMSG: other/msg/Time\nint32 sec\n"
    )
    assert parse_definition("made_up/msg/Thing", text).fields == (
        Field("header.stamp.sec", "i4"),
        Field("header.stamp.nanosec", "u4"),
        Field("header.frame_id", TEXT),
        Field("pair.first", "u1"),
        Field("pair.when.sec", "i4"),
        Field("fixed", "f4", 3),
        Field("bounded", "i2", 0),
        Field("words", TEXT, 0),
        Field("half", "f8"),
    )


def test_for_a_type_without_an_embedded_definition_ours_is_used():
    assert message_type(JOINT_STATE.name, "ros2idl", "module sensor_msgs {}") == JOINT_STATE
    assert message_type(JOINT_STATE.name, "", "") == JOINT_STATE


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("Part[] parts\n===\nMSG: p/Part\nint32 a", "parts"),
        ("Missing thing", "thing"),
        ("wstring text", "text"),
        ("Loop loop\n===\nMSG: p/Loop\nLoop again", "deeply"),
        ("??? what", r"\?\?\?"),
    ],
)
def test_a_definition_that_cannot_be_parsed_is_refused_with_its_line(text, word):
    with pytest.raises(BagError, match=word):
        parse_definition("p/msg/Thing", text)


def test_an_unknown_type_without_a_text_is_refused():
    with pytest.raises(BagError, match="p/msg/Thing"):
        message_type("p/msg/Thing", "ros2idl", "")


def test_short_names_of_types_are_accepted():
    assert long_name("sensor_msgs/JointState") == JOINT_STATE.name
    assert long_name(JOINT_STATE.name) == JOINT_STATE.name
    assert long_name("odd") == "odd"


def test_our_definitions_carry_every_message_they_use_and_a_hash():
    for name in ("cdrj_msgs/msg/CableTensions", "cdrj_msgs/msg/NodalForces", JOINT_STATE.name):
        definition = own_definition(name)
        assert "MSG: std_msgs/Header" in definition.text
        assert "MSG: builtin_interfaces/Time" in definition.text
        assert definition.hash.startswith("RIHS01_")
    with pytest.raises(BagError, match="no definition of p/msg/Thing"):
        own_definition("p/msg/Thing")
