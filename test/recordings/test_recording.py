"""Results of read_recording for complete bags."""

import re
from dataclasses import replace

import numpy as np
import pytest
import zstandard

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.messages.templates import Template
from cdrj_ros.recordings.definitions import parse_definition
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import read_messages
from cdrj_ros.recordings.writer import BagWriter

ONE_TOPIC = Topics("/joint_states", "/joint_states", ("/joint_states",))
MS = 1_000_000


def one_joint_state(make):
    """A valid message for a topic that the test does not concern."""
    return [(0, make.joint_state(1, ["a"], [1]))]


def test_every_channel_comes_back_as_it_was_written(tmp_path):
    rng = np.random.default_rng(1)
    t = 1_700_000_000_000_000_000 + np.arange(500) * MS
    motors, joints = rng.normal(size=(500, 2)), rng.normal(size=(250, 1))
    tensions, forces, efforts = (rng.normal(size=(500, k)) for k in (3, 2, 2))
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states("/cdrj/motor_states", t, ["left", "right"], motors)
        bag.write_joint_states(
            "/cdrj/joint_states", t[::2], ["elbow"], joints, log_ns=t[::2] + 5, frame_id="arm"
        )
        bag.write_tensions("/reference/tensions", t, ["up/1", "up/2", "up/3"], tensions)
        bag.write_nodal_forces("/reference/nodal_forces", t, ["up/1", "up/2"], forces)
        bag.write_joint_states("/reference/efforts", t, ["left", "right"], effort=efforts)
    read = read_recording(tmp_path / "bag")
    assert (read.start_ns, read.end_ns) == (t[0], t[-1])
    assert read.notes == ()
    assert list(read.motors) == ["left", "right"]
    np.testing.assert_array_equal(read.motors["right"].value, motors[:, 1])
    np.testing.assert_array_equal(read.joints["elbow"].value, joints[:, 0])
    np.testing.assert_array_equal(read.joints["elbow"].stamp_ns, t[::2])
    np.testing.assert_array_equal(read.joints["elbow"].log_ns, t[::2] + 5)
    np.testing.assert_array_equal(read.references["tension/up/3"].value, tensions[:, 2])
    np.testing.assert_array_equal(read.references["nodal_force/up/1"].value, forces[:, 0])
    np.testing.assert_array_equal(read.references["effort/right"].value, efforts[:, 1])
    assert len(read.references) == 7
    for series in (*read.motors.values(), *read.joints.values(), *read.references.values()):
        assert series.value.dtype == np.float64
        assert series.stamp_ns.dtype == series.log_ns.dtype == np.int64
        for values in (series.stamp_ns, series.log_ns, series.value):
            assert values.flags.c_contiguous
            assert not values.flags.writeable


@pytest.mark.parametrize("little_endian", [True, False])
def test_motors_joints_and_efforts_may_share_one_topic(make, tmp_path, little_endian):
    path = make.write_mcap(tmp_path / "a.mcap", make.swing(300, little_endian=little_endian))
    read = read_recording(path, ONE_TOPIC)
    assert list(read.motors) == list(read.joints) == ["motor", "joint"]
    np.testing.assert_array_equal(read.motors["motor"].value, np.arange(300))
    np.testing.assert_array_equal(read.joints["joint"].value, -np.arange(300))
    np.testing.assert_array_equal(read.references["effort/joint"].value, -2 * np.arange(300))
    np.testing.assert_array_equal(
        read.motors["motor"].stamp_ns, make.START_NS + np.arange(300) * MS
    )


def test_names_may_change_their_order_and_number_within_a_recording(make, tmp_path):
    forms = [["motor", "joint"], ["joint", "motor"], ["motor"], ["idler", "motor", "joint"]]
    angle = {"motor": 1.0, "joint": -1.0, "idler": 7.0}
    messages = []
    for i in range(400):
        names = forms[i // 100 if i < 300 else i % 4]
        values = [angle[name] * (i + 1) for name in names]
        messages.append((make.TOPIC, i, make.joint_state(i + 1, names, values)))
    read = read_recording(make.write_mcap(tmp_path / "a.mcap", messages), ONE_TOPIC)
    np.testing.assert_array_equal(read.motors["motor"].value, np.arange(400) + 1.0)
    np.testing.assert_array_equal(read.motors["motor"].log_ns, np.arange(400))
    has_joint = [i for i, (_, _, data) in enumerate(messages) if b"joint\0" in data]
    np.testing.assert_array_equal(read.joints["joint"].log_ns, has_joint)
    np.testing.assert_array_equal(read.joints["joint"].value, -np.array(has_joint) - 1.0)
    assert read.motors["idler"].value.size == 25


def test_messages_that_are_refused_whole_are_counted(make, tmp_path):
    good = make.joint_state(1, ["a", "b"], [1, 2], [3, 4])
    bad = [
        make.joint_state(1, ["a", "b"], [1]),
        make.joint_state(1, ["a"], [1, 2]),
        good[:-1],
        good[:7],
        b"",
        b"\0\1\0\0" + b"\xff" * 60,
        b'{"name": ["a"], "position": [1]}',
    ]
    payloads = [good, *bad, good, *bad, good, make.joint_state(1, [], [])]
    messages = [(make.TOPIC, i, payload) for i, payload in enumerate(payloads)]
    read = read_recording(make.write_mcap(tmp_path / "a.mcap", messages), ONE_TOPIC)
    assert read.malformed == {make.TOPIC: 2 * len(bad)}
    np.testing.assert_array_equal(read.motors["b"].log_ns, [0, 1 + len(bad), 2 * len(bad) + 2])
    np.testing.assert_array_equal(read.motors["b"].value, [2, 2, 2])


def test_a_message_without_efforts_is_no_malformed_reference(make, tmp_path):
    messages = [
        (make.TOPIC, 0, make.joint_state(1, ["a"], [1])),
        (make.TOPIC, 1, make.joint_state(2, ["a"], [1], effort=[4])),
    ]
    read = read_recording(make.write_mcap(tmp_path / "a.mcap", messages), ONE_TOPIC)
    assert read.malformed == {make.TOPIC: 0}
    np.testing.assert_array_equal(read.references["effort/a"].log_ns, [1])


def test_the_log_time_replaces_a_header_stamp_of_zero_and_a_note_says_so(make, tmp_path):
    for stamps, expected in (([0, 0, 0], [5, 6, 7]), ([0, 0, 3], [5, 6, 3]), ([1, 2, 4], None)):
        messages = [
            (make.TOPIC, 5 + i, make.joint_state(stamp, ["m"], [i]))
            for i, stamp in enumerate(stamps)
        ]
        path = make.write_mcap(tmp_path / f"{stamps[2]}.mcap", messages)
        read = read_recording(path, ONE_TOPIC)
        np.testing.assert_array_equal(read.motors["m"].stamp_ns, expected or stamps)
        assert read.motors["m"].by_arrival == bool(expected)
        assert any("header stamps are zero" in note for note in read.notes) == bool(expected)


def test_topics_that_are_missing_are_named_with_those_that_are_there(make, tmp_path):
    path = make.write_mcap(tmp_path / "a.mcap", make.swing(3))
    with pytest.raises(BagError, match=r"a\.mcap has no topic /cdrj/motor_states.*/joint_states"):
        read_recording(path)
    with pytest.raises(BagError, match=r"no topic /nowhere.*--motor-topic and --joint-topic"):
        read_recording(path, replace(ONE_TOPIC, joints="/nowhere"))
    read = read_recording(path, replace(ONE_TOPIC, references=("/nowhere",)))
    assert not read.references


def test_a_topic_of_another_type_is_refused_by_both_names(make, tmp_path):
    path = make.write_mcap(tmp_path / "a.mcap", make.swing(3), msgtype="std_msgs/msg/String")
    with pytest.raises(BagError, match=r"std_msgs/msg/String, expected sensor_msgs/msg/JointState"):
        read_recording(path, ONE_TOPIC)
    path = make.write_topics(
        tmp_path / "b.mcap",
        {
            make.TOPIC: ("sensor_msgs/msg/JointState", "", one_joint_state(make)),
            "/odd": ("std_msgs/msg/String", "", [(1, b"")]),
            "/tensions": ("cdrj_msgs/msg/CableTensions", "", [(1, b"")]),
        },
    )
    with pytest.raises(BagError, match=r"/odd for references is std_msgs/msg/String, expected"):
        read_recording(path, replace(ONE_TOPIC, references=("/odd",)))
    with pytest.raises(
        BagError, match=r"/tensions for joint angles is cdrj_msgs/msg/CableTensions"
    ):
        read_recording(path, replace(ONE_TOPIC, joints="/tensions"))


def test_a_definition_with_other_fields_is_used_if_it_has_what_is_needed(make, tmp_path):
    kind, text = (
        "cdrj_msgs/msg/CableTensions",
        "std_msgs/Header header\nuint8 gauge\nstring[] name\n",
    )
    wanted = replace(ONE_TOPIC, references=("/t",))

    def bag(definition, messages):
        angles = ("sensor_msgs/msg/JointState", "", one_joint_state(make))
        topics = {make.TOPIC: angles, "/t": (kind, definition, messages)}
        return make.write_topics(tmp_path / "a.mcap", topics)

    own = text + "float32[] tension\n"
    template = Template(parse_definition(kind, own), ["u/1"])
    raw = [(i, template.encode(i + 1, tension=[i / 2])) for i in range(20)]
    read = read_recording(bag(own, raw), wanted)
    np.testing.assert_array_equal(read.references["tension/u/1"].value, np.arange(20) / 2)
    lacking = bag("string[] name\nfloat64[] pull\n", [(1, b"\0\1\0\0")])
    with pytest.raises(BagError, match=rf"/t: {kind} .* 'tension', but name, pull"):
        read_recording(lacking, wanted)


def test_messages_that_rosbag2_compressed_one_by_one_are_read_without_metadata(make, tmp_path):
    plain = [(make.TOPIC, i, make.joint_state(i + 1, ["a", "é"], [i, -i])) for i in range(60)]
    packed = [(topic, i, zstandard.compress(data) if i % 3 else data) for topic, i, data in plain]
    paths = [make.write_mcap(tmp_path / f"{k}.mcap", one) for k, one in enumerate((plain, packed))]
    for name in ("a", "é"):
        one, other = (read_recording(path, ONE_TOPIC).motors[name] for path in paths)
        np.testing.assert_array_equal(one.value, other.value)
        np.testing.assert_array_equal(one.stamp_ns, other.stamp_ns)
    one, other = (list(read_messages(path, [make.TOPIC])) for path in paths)
    assert one == other


def test_a_bomb_of_compressed_messages_is_refused_within_bounds(make, tmp_path):
    bomb, good = zstandard.compress(bytes(1 << 27)), make.joint_state(1, ["a"], [1])
    messages = [(make.TOPIC, 0, bomb), (make.TOPIC, 1, good)]
    read = read_recording(make.write_mcap(tmp_path / "a.mcap", messages), ONE_TOPIC)
    assert read.malformed == {make.TOPIC: 1}
    assert read.motors["a"].value.tolist() == [1.0]


@pytest.mark.parametrize(
    ("spoiled", "words"),
    [
        (lambda good, i: bytes((0, 6 + i)) + good[2:], r"XCDR2 \(encapsulation 0006\).*to XCDR1"),
        (lambda good, _: zstandard.compress(good)[:-3], "it is compressed, and damaged"),
    ],
)
def test_messages_in_another_form_are_named_with_what_to_do(make, tmp_path, spoiled, words):
    """The second version of CDR, and rosbag2's message mode of compression, cut off."""
    good = make.joint_state(1, ["a"], [1])
    messages = [(make.TOPIC, i, spoiled(good, i)) for i in range(6)]
    path = make.write_mcap(tmp_path / "a.mcap", messages)
    with pytest.raises(BagError, match=f"6 malformed messages, the first: .*{words}"):
        read_recording(path, ONE_TOPIC)
    read = read_recording(make.write_mcap(path, [*messages, (make.TOPIC, 6, good)]), ONE_TOPIC)
    assert read.malformed == {make.TOPIC: 6}
    assert any(re.search(words, note) for note in read.notes)


def test_a_reference_that_is_not_a_measurement_is_left_out_with_a_note(tmp_path):
    t = np.arange(4) + 1
    tension = np.array([[1.0], [1e200], [-1e16], [2.0]])
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states("/joint_states", t, ["a"], np.zeros((4, 1)))
        bag.write_tensions("/t", t, ["u/1"], tension)
    read = read_recording(tmp_path / "bag", replace(ONE_TOPIC, references=("/t",)))
    np.testing.assert_array_equal(read.references["tension/u/1"].value, [1, np.nan, np.nan, 2])
    assert read.notes == ("tension/u/1: 2 values beyond 1e+15 were left out",)


def test_control_characters_in_names_are_escaped(make, tmp_path):
    messages = [(make.TOPIC, 1, make.joint_state(1, ["a\x1b[31m\nb"], [1]))]
    read = read_recording(make.write_mcap(tmp_path / "a.mcap", messages), ONE_TOPIC)
    assert list(read.motors) == [r"a\x1b[31m\nb"]


def test_the_same_channel_on_two_reference_topics_is_refused(tmp_path):
    t = np.arange(3)
    with BagWriter(tmp_path / "bag") as bag:
        for topic in ("/one", "/two"):
            bag.write_joint_states(topic, t, ["a"], np.zeros((3, 1)), effort=np.zeros((3, 1)))
    with pytest.raises(BagError, match="effort/a is on several reference topics"):
        read_recording(tmp_path / "bag", Topics("/one", "/two", ("/one", "/two")))
