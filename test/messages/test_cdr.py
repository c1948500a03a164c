"""Payloads are compared with rosbags' serializer; invalid payloads are refused."""

import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdrj_ros._core import JointStateDecoder
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    JOINT_STATE,
    MESSAGE_TYPES,
    NODAL_FORCES,
    MessageError,
    read_layout,
)
from cdrj_ros.messages.templates import Template
from cdrj_ros.recordings.definitions import own_definition, parse_definition

numbers = st.floats(width=64)
letters = st.characters(exclude_categories=("Cs",), exclude_characters="\0")  # all of UTF-8
names = st.lists(st.text(letters), max_size=5)
stamps = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
some_arrays = st.tuples(st.booleans(), st.booleans(), st.booleans())


def values(draw, count):
    return draw(st.lists(numbers, min_size=count, max_size=count))


@given(st.data(), stamps, names, some_arrays, st.text("abc/_é", max_size=9), st.booleans())
def test_a_joint_state_is_decoded_as_rosbags_wrote_it(
    make, data, stamp_ns, names, present, frame_id, little_endian
):
    arrays = [values(data.draw, len(names)) if there else [] for there in present]
    payload = make.joint_state(
        stamp_ns, names, *arrays, frame_id=frame_id, little_endian=little_endian
    )
    message = JointStateDecoder()
    assert message.decode(payload, 7)
    assert message.stamp_ns == (stamp_ns or 7)
    assert message.by_arrival == (stamp_ns == 0)
    assert message.names == tuple(names)
    np.testing.assert_array_equal(message.positions, arrays[0])
    np.testing.assert_array_equal(message.efforts, arrays[2])


@given(st.data(), stamps, names, st.text("abc/_é", max_size=9))
def test_rosbags_reads_what_a_template_wrote(make, data, stamp_ns, names, frame_id):
    message = data.draw(st.sampled_from(list(MESSAGE_TYPES.values())))
    sequences = list(Template(message, names).spans)
    chosen = data.draw(st.sets(st.sampled_from(sequences)))
    template = Template(message, names, chosen, frame_id)
    arrays = {
        name: np.arange(len(names), dtype=np.uint8)
        if name == "status"
        else np.array(values(data.draw, len(names)), float)
        for name in chosen
    }
    payload = template.encode(stamp_ns, **arrays)
    read = make.STORE.deserialize_cdr(payload, message.name)
    assert read.header == make.header(stamp_ns, frame_id)
    assert read.name == list(names)
    for name in sequences:
        np.testing.assert_array_equal(getattr(read, name), arrays.get(name, []))
    assert payload == bytes(make.STORE.serialize_cdr(read, message.name))


@given(st.data(), st.lists(stamps, max_size=4), names)
def test_many_messages_at_once_are_the_same_as_one_by_one(data, stamps, names):
    template = Template(JOINT_STATE, names, ("position", "effort"))
    shape = (len(stamps), len(names))
    arrays = {
        name: np.array([values(data.draw, len(names)) for _ in stamps], float).reshape(shape)
        for name in template.spans
    }
    rows = template.encode_many(np.array(stamps, np.int64), arrays)
    one_by_one = [
        template.encode(stamp, **{name: array[i] for name, array in arrays.items()})
        for i, stamp in enumerate(stamps)
    ]
    assert [row.tobytes() for row in rows] == one_by_one


@given(st.binary(max_size=200))
def test_bytes_that_are_not_a_message_are_refused_with_a_reason(payload):
    for start in (b"", b"\0\1\0\0", b"\0\0\0\0"):
        assert not JointStateDecoder().decode(start + payload[:15])
        with pytest.raises(MessageError, match=r"\w"):
            read_layout(start + payload[:15], JOINT_STATE.fields)


@given(st.data(), st.booleans(), st.booleans())
def test_a_damaged_message_is_decoded_as_its_layout_says_or_refused_with_it(
    make, data, little_endian, efforts
):
    payload = make.joint_state(
        5, ["a", "bć"], [1, 2], [3, 4], [5, 6], frame_id="é", little_endian=little_endian
    )
    damaged = bytearray(payload)
    for at in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        damaged[at] = data.draw(st.one_of(st.integers(0, 255), st.sampled_from((0, 1, 2, 3))))
    message = JointStateDecoder(efforts)
    assert message.decode(payload)
    try:
        layout = read_layout(bytes(damaged), JOINT_STATE.fields)
    except MessageError:
        layout = None
    found = None if layout is None else _positions_and_efforts(layout, bytes(damaged), efforts)
    assert message.decode(bytes(damaged)) == (found is not None)
    if layout is not None and found is not None:
        assert message.names == layout.texts["name"]
        assert (message.positions.tobytes(), message.efforts.tobytes()) == found


def _positions_and_efforts(layout, payload, with_efforts):
    """The numbers that a layout locates; None if their number does not fit that of the names."""
    count = len(layout.texts["name"])
    position, effort = layout.numbers["position"], layout.numbers["effort"]
    if position.count not in (0, count) or (with_efforts and effort.count not in (0, count)):
        return None
    position_numbers, effort_numbers = (
        np.frombuffer(payload, span.dtype, span.count, span.offset).astype(np.float64).tobytes()
        for span in (position, effort)
    )
    return position_numbers, effort_numbers


def test_an_absurd_length_allocates_nothing():
    head = b"\0\1\0\0" + bytes(8) + struct.pack("<I", 1) + b"\0\0\0\0"
    for payload in (
        head + struct.pack("<I", 2**32 - 1) + bytes(64),
        head + struct.pack("<II", 0, 2**32 - 1) + bytes(64),
        b"\0\1\0\0" + bytes(8) + struct.pack("<I", 2**32 - 1) + bytes(64),
    ):
        tracemalloc.start()
        with pytest.raises(MessageError):
            read_layout(payload, JOINT_STATE.fields)
        assert tracemalloc.get_traced_memory()[1] < 100_000
        tracemalloc.stop()
        assert not JointStateDecoder().decode(payload)  # 34 GB would not be there


def test_an_encapsulation_that_is_not_plain_cdr_is_refused_by_its_bytes(make):
    payload = make.joint_state(0, ["a"], [1.0])
    for start, words in (
        (b"\0\3\0\0", "00030000, expected plain CDR"),
        (b"\0\7\0\0", r"is XCDR2 .encapsulation 0007.*record again"),
    ):
        with pytest.raises(MessageError, match=words):
            read_layout(start + payload[4:], JOINT_STATE.fields)
        assert not JointStateDecoder().decode(start + payload[4:])


def test_bytes_after_the_last_field_are_allowed(make):
    payload = make.joint_state(7, ["a"], [1.5])
    message = JointStateDecoder()
    assert message.decode(payload + b"\0\0")
    assert message.positions == [1.5]


@pytest.mark.parametrize(
    "text",
    [
        b"\x80", b"\xc1\xbf", b"\xe0\x9f\xbf", b"\xed\xa0\x80", b"\xf0\x8f\xbf\xbf",
        b"\xf4\x90\x80\x80", b"\xf5\x80\x80\x80", b"\xe2\x82", b"a\xf0\x9f\x98", b"\xc3(",
        b"\xc2\x80", b"\xdf\xbf", b"\xe0\xa0\x80", b"\xed\x9f\xbf", b"\xee\x80\x80",
        b"\xf0\x90\x80\x80", b"\xf4\x8f\xbf\xbf", b"",
    ],
)  # fmt: skip
def test_names_are_unicode_as_python_decodes_it(make, text):
    """Longer forms than needed, surrogates and what is beyond the last character are refused."""
    payload = make.joint_state(7, ["x" * len(text)], [1.5]).replace(b"x" * len(text), text, 1)
    try:
        expected = text.decode()
    except UnicodeDecodeError:
        expected = None
    message = JointStateDecoder()
    assert message.decode(payload) == (expected is not None)
    assert message.names == (() if expected is None else (expected,))


@pytest.mark.parametrize("message", MESSAGE_TYPES.values(), ids=lambda message: message.name)
def test_the_fields_written_here_are_those_of_the_definition(message):
    assert parse_definition(message.name, own_definition(message.name).text) == message


def test_a_template_refuses_other_arrays_and_names_its_own():
    template = Template(CABLE_TENSIONS, ["upper/1", "upper/2"])
    good = {"tension": [1, 2], "stddev": [0, 0], "status": [0, 0]}
    template.encode(0, **good)
    for wrong in (
        {"tension": [1, 2]},
        good | {"tension": [1, 2, 3]},
        {"tension": [1, 2], "stddev": [0, 0], "colour": [0, 0]},
    ):
        with pytest.raises(MessageError, match=r"tension.*stddev.*status"):
            template.encode(0, **wrong)
    with pytest.raises(MessageError, match="has no arrays"):
        Template(NODAL_FORCES, [], ["tension"])


@pytest.mark.parametrize("stamp_ns", [2**31 * 10**9, -(2**31) * 10**9 - 1])
def test_a_stamp_beyond_32_bit_seconds_is_refused(stamp_ns):
    template = Template(JOINT_STATE, [], ())
    with pytest.raises(MessageError, match="does not fit"):
        template.encode(stamp_ns)
    with pytest.raises(MessageError, match="does not fit"):
        template.encode_many(np.array([stamp_ns]), {})


def test_a_decoder_of_efforts_refuses_efforts_for_only_some_names(make):
    payload = make.joint_state(5, ["a", "b"], [1.0, 2.0], [], [3.0])
    assert JointStateDecoder().decode(payload)
    assert not JointStateDecoder(efforts=True).decode(payload)
    for efforts in ([], [3.0, -4.5]):
        message = JointStateDecoder(efforts=True)
        assert message.decode(make.joint_state(5, ["a", "b"], [1.0, 2.0], [], efforts))
        assert message.efforts.tolist() == efforts
