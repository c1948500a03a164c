"""Written bags are readable by other libraries."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import read_messages
from cdrj_ros.recordings.writer import BagWriter

COUNT = 30_000
T = 1_700_000_000_000_000_000 + np.arange(COUNT) * 1_000_000


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "bag"
    rng = np.random.default_rng(8)
    arrays = {"motor": rng.normal(size=(COUNT, 2)), "tension": rng.normal(size=(COUNT // 2, 3))}
    with BagWriter(path) as bag:
        bag.write_tensions(
            "/tensions", T[::2], ["u/1", "u/2", "u/3"], arrays["tension"], log_ns=T[::2] + 7
        )
        bag.write_joint_states("/motors", T, ["left", "right"], arrays["motor"])
        bag.write_nodal_forces("/forces", T[:1], ["u/1"], [[3.0]], friction=[[-1.0]])
        bag.write_joint_states("/never", [], ["x"], np.zeros((0, 1)))
    return path, arrays


def test_rosbags_reads_every_message_with_the_definitions_embedded(written):
    path, arrays = written
    with AnyReader([path]) as reader:
        motors, tensions, forces = [], [], []
        last = 0
        for connection, log_ns, data in reader.messages():
            assert log_ns >= last
            last = log_ns
            message = reader.deserialize(data, connection.msgtype)
            stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            place = {"/motors": motors, "/tensions": tensions, "/forces": forces}
            place[connection.topic].append((log_ns, stamp, message))
    np.testing.assert_array_equal([stamp for _, stamp, _ in motors], T)
    np.testing.assert_array_equal([log_ns for log_ns, _, _ in tensions], T[::2] + 7)
    np.testing.assert_array_equal([m.position for *_, m in motors], arrays["motor"])
    np.testing.assert_array_equal([m.tension for *_, m in tensions], arrays["tension"])
    assert tensions[0][2].name == ["u/1", "u/2", "u/3"]
    assert tensions[0][2].stddev.size == 0
    assert tensions[0][2].status.tolist() == [0, 0, 0]
    (_, _, force) = forces[0]
    assert (force.magnitude, force.friction, force.force_x.size) == ([3.0], [-1.0], 0)


def test_mcap_reads_the_file_by_its_index_and_checks_its_sums(written):
    path, _ = written
    (file,) = path.glob("*.mcap")
    with file.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary.statistics.message_count == 3 * COUNT // 2 + 1
        assert len(summary.chunk_indexes) > 3
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        times = [message.log_time for _, _, message in reader.iter_messages()]
        assert len(times) == 3 * COUNT // 2 + 1
        assert times == sorted(times)
        assert len(list(reader.iter_messages(topics=["/tensions"]))) == COUNT // 2
        assert reader.get_header().profile == "ros2"
        (metadata,) = reader.iter_metadata()
        assert metadata.name == "rosbag2"


def test_the_folder_appears_complete_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "bag"
    seen = []

    def see(folder, target):
        (file,) = folder.glob("*.mcap")
        with file.open("rb") as stream:
            assert make_reader(stream).get_summary().statistics.message_count == 1
        seen.append((path.exists(), sorted(entry.name for entry in folder.iterdir())))
        return rename(folder, target)

    rename = Path.rename
    monkeypatch.setattr(Path, "rename", see)
    with BagWriter(path) as bag:
        bag.write_joint_states("/a", [1], ["x"], [[1.0]])
    assert seen == [(False, ["bag_0.mcap", "metadata.yaml"])]
    assert [entry.name for entry in tmp_path.iterdir()] == ["bag"]
    with pytest.raises(BagError, match="exists already"):
        BagWriter(path)


@pytest.mark.parametrize("name", ["bag\udc80", "bag\n", "bag\x1b[31m"])
def test_a_name_that_metadata_cannot_hold_is_refused(tmp_path, name):
    with pytest.raises(BagError, match="not a name for a bag") as caught:
        BagWriter(tmp_path / name)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("stamp", [1, 2**62])
def test_nothing_is_left_behind_where_the_body_raises_or_writing_fails(tmp_path, stamp):
    def body():
        with BagWriter(tmp_path / "bag") as bag:
            bag.write_joint_states("/a", [stamp], ["x"], [[1.0]])
            if stamp == 1:
                raise BagError("stamp does not fit the test")

    with pytest.raises(BagError, match="stamp does not fit"):
        body()
    assert list(tmp_path.iterdir()) == []


def test_a_topic_may_be_written_in_pieces_and_out_of_order(tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states("/a", [5, 3], ["x"], [[5.0], [3.0]])
        bag.write_joint_states("/a", [4, 3], ["x"], [[4.0], [3.5]])
    series = read_recording(tmp_path / "bag", Topics("/a", "/a")).motors["x"]
    assert series.value.tolist() == [3, 3.5, 4, 5]


def test_a_copied_type_keeps_the_definition_it_had(make, tmp_path):
    fields = "string[] name\nfloat32[] tension\n"
    path = make.write_topics(
        tmp_path / "a.mcap",
        {
            "/ours": ("cdrj_msgs/msg/CableTensions", "", [(1, b"")]),
            "/theirs": ("cdrj_msgs/msg/CableTensions", fields, [(1, b"")]),
        },
    )
    with BagWriter(tmp_path / "copy") as bag:
        bag.copy(path)
        bag.write_tensions("/ours", [1], ["u/1"], [[1.0]])
        with pytest.raises(BagError, match=r"/theirs .* other fields"):
            bag.write_tensions("/theirs", [1], ["u/1"], [[1.0]])
    (file,) = (tmp_path / "copy").glob("*.mcap")
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    texts = {c.topic: summary.schemas[c.schema_id].data for c in summary.channels.values()}
    assert texts["/theirs"].decode() == fields
    assert b"stddev" in texts["/ours"]


def test_a_copy_holds_the_same_messages_beside_new_ones(make, tmp_path, written):
    path, _ = written
    other = make.write_mcap(tmp_path / "other.mcap", make.swing(50))
    with BagWriter(tmp_path / "copy") as bag:
        bag.copy(path)
        bag.copy(other, ["/joint_states", "/not/there"])
        bag.write_joint_states("/new", T[:5], ["x"], np.zeros((5, 1)))
    topics = ["/motors", "/tensions", "/forces"]
    original = list(read_messages(path, topics))
    copied = list(read_messages(tmp_path / "copy", topics))
    assert sorted(copied) == sorted(original)
    assert [m.log_ns for m in copied] == [m.log_ns for m in original]
    with AnyReader([tmp_path / "copy"]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
    assert counts == {
        "/motors": COUNT,
        "/tensions": COUNT // 2,
        "/forces": 1,
        "/never": 0,
        "/joint_states": 50,
        "/new": 5,
    }


@pytest.mark.parametrize(
    ("stamps", "position", "log_ns"),
    [([1, 2], [[1.0]], None), ([1], [[1.0, 2.0]], None), ([1], [[1.0]], [1, 2]), (1, [1.0], None)],
)
def test_arrays_of_the_wrong_shape_are_refused_with_both_shapes(tmp_path, stamps, position, log_ns):
    with pytest.raises(BagError, match=r"/a: \(.*take arrays of shape"):
        BagWriter(tmp_path / "bag").write_joint_states("/a", stamps, ["x"], position, log_ns=log_ns)


def test_a_topic_keeps_its_type(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.write_joint_states("/a", [1], ["x"], [[1.0]])
    with pytest.raises(BagError, match=r"/a is sensor_msgs/msg/JointState, it cannot also be"):
        bag.write_tensions("/a", [1], ["x"], [[1.0]])


def test_a_folder_that_has_appeared_meanwhile_is_not_replaced(tmp_path):
    bag = BagWriter(tmp_path / "bag")
    bag.write_joint_states("/a", [1], ["x"], [[1.0]])
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "mine").touch()
    with pytest.raises(BagError, match="cannot be made"):
        bag.close()
    assert [entry.name for entry in (tmp_path / "bag").iterdir()] == ["mine"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["bag"]
