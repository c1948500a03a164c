"""Payloads are compared with rosbags' serializer; invalid payloads are refused."""

import struct
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdrj_ros.bag.definitions import own_definition, parse_definition
from cdrj_ros.messages.cdr import (
    CABLE_TENSIONS,
    JOINT_STATE,
    MESSAGE_TYPES,
    NODAL_FORCES,
    MessageError,
    read_layout,
)
from cdrj_ros.messages.decoders import JointStateDecoder
from cdrj_ros.messages.templates import Template

numbers = st.floats(width=64)
letters = st.characters(exclude_categories=("Cs",), exclude_characters="\0")  # all of UTF-8
names = st.lists(st.text(letters), max_size=5)
stamps = st.integers(0, 2**31 * 10**9 - 1)
some_arrays = st.tuples(st.booleans(), st.booleans(), st.booleans())


def values(draw, count):
    return draw(st.lists(numbers, min_size=count, max_size=count))


@given(st.data(), stamps, names, some_arrays, st.text("abc/_é", max_size=9), st.booleans())
def test_a_joint_state_is_decoded_as_rosbags_wrote_it(
    make, data, stamp_ns, names, present, frame_id, little_endian
):
    position = values(data.draw, len(names))
    others = [values(data.draw, len(names)) if there else [] for there in present[1:]]
    payload = make.joint_state(
        stamp_ns, names, position, *others, frame_id=frame_id, little_endian=little_endian
    )
    decode = JointStateDecoder()
    for _ in range(2):
        found_stamp, found_names, found = decode(payload)
        assert found_stamp == stamp_ns
        assert found_names == tuple(names)
        np.testing.assert_array_equal(found, position)
        assert found.dtype == np.float64
        assert found.flags.aligned
        assert not found.flags.writeable


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
    read = make.store.deserialize_cdr(payload, message.name)
    assert read.header == make.header(stamp_ns, frame_id)
    assert read.name == list(names)
    for name in sequences:
        np.testing.assert_array_equal(getattr(read, name), arrays.get(name, []))
    assert payload == bytes(make.store.serialize_cdr(read, message.name))


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
        with pytest.raises(MessageError, match=r"\w"):
            JointStateDecoder()(start + payload[:15])


@given(st.data(), st.booleans())
def test_a_damaged_payload_is_decoded_or_refused_but_never_crashes(make, data, little_endian):
    payload = make.joint_state(5, ["a", "bc"], [1, 2], [3, 4], little_endian=little_endian)
    damaged = bytearray(payload)
    for at in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        damaged[at] = data.draw(st.integers(0, 255))
    decode = JointStateDecoder()
    decode(payload)
    try:
        _, found_names, position = decode(bytes(damaged))
    except MessageError:
        return
    assert len(found_names) == len(position)


def test_a_payload_truncated_anywhere_is_refused(make):
    payload = make.joint_state(5, ["a", "bc"], [1, 2], [3, 4], [5, 6], frame_id="base")
    decode = JointStateDecoder()
    decode(payload)
    for size in range(len(payload)):
        with pytest.raises(MessageError):
            decode(payload[:size])


def test_an_absurd_length_allocates_nothing():
    head = b"\0\1\0\0" + bytes(8) + struct.pack("<I", 1) + b"\0\0\0\0"
    for payload in (
        head + struct.pack("<I", 2**32 - 1) + bytes(64),
        head + struct.pack("<II", 0, 2**32 - 1) + bytes(64),
        b"\0\1\0\0" + bytes(8) + struct.pack("<I", 2**32 - 1) + bytes(64),
    ):
        tracemalloc.start()
        with pytest.raises(MessageError):
            JointStateDecoder()(payload)
        assert tracemalloc.get_traced_memory()[1] < 100_000
        tracemalloc.stop()


def test_names_and_positions_of_different_number_are_refused_with_both_numbers(make):
    with pytest.raises(MessageError, match="2 names but 1 positions"):
        JointStateDecoder()(make.joint_state(0, ["a", "b"], [1.0]))


def test_an_encapsulation_that_is_not_plain_cdr_is_refused_by_its_bytes(make):
    payload = make.joint_state(0, ["a"], [1.0])
    with pytest.raises(MessageError, match="00030000, expected plain CDR"):
        JointStateDecoder()(b"\0\3\0\0" + payload[4:])
    with pytest.raises(MessageError, match=r"is XCDR2 .encapsulation 0007.*record again"):
        JointStateDecoder()(b"\0\7\0\0" + payload[4:])


def test_bytes_after_the_last_field_are_allowed(make):
    payload = make.joint_state(7, ["a"], [1.5])
    assert JointStateDecoder()(payload + b"\0\0")[2] == [1.5]


def test_padding_may_have_any_content(make):
    payload = bytearray(make.joint_state(7, ["a"], [1.5]))
    layout = read_layout(bytes(payload), JOINT_STATE.fields)
    ranges = list(layout.fixed) + [
        (span.offset, span.offset + span.count * int(span.dtype[2:]))
        for span in layout.numbers.values()
        if span.count
    ]
    ranges.sort()
    behind_the_frame = 20
    gaps = [(a, b) for (_, a), (b, _) in pairwise(ranges) if b > a > behind_the_frame]
    assert gaps
    for a, b in gaps:
        payload[a:b] = b"\xaa" * (b - a)
    assert JointStateDecoder()(bytes(payload)) == (7, ("a",), [1.5])


def test_senders_that_share_a_topic_do_not_disturb_each_other(make):
    decode = JointStateDecoder()
    for i in range(50):
        name = f"joint{i % 12:02}"
        stamp, found, position = decode(make.joint_state(i, [name], [i]))
        assert (stamp, found, position.tolist()) == (i, (name,), [i])


def test_a_layout_seen_before_does_not_hide_damage_behind_the_positions(make):
    decode = JointStateDecoder()
    payload = make.joint_state(0, ["a"], [1.0], [2.0])
    decode(payload)
    damaged = bytearray(payload)
    damaged[read_layout(payload, JOINT_STATE.fields).numbers["velocity"].offset - 8] = 200
    with pytest.raises(MessageError, match="velocity"):
        decode(bytes(damaged))


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


def test_the_layout_of_a_message_gives_its_efforts_and_its_stamp(make):
    decode = JointStateDecoder(efforts=True)
    for efforts in ([3.0, -4.5], [], [7.0, 8.0]):
        payload = make.joint_state(5, ["a", "b"], [1.0, 2.0], [], efforts)
        assert decode(payload)[1] == ("a", "b")
        known = decode.last
        assert known is not None
        assert known.efforts(payload).tolist() == efforts
        assert known.stamp_ns(payload) == 5


def test_a_decoder_of_efforts_refuses_efforts_for_only_some_names(make):
    payload = make.joint_state(5, ["a", "b"], [1.0, 2.0], [], [3.0])
    assert JointStateDecoder()(payload)[1] == ("a", "b")
    with pytest.raises(MessageError, match="2 names but 1 efforts"):
        JointStateDecoder(efforts=True)(payload)
