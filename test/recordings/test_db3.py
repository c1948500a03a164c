"""Reading of bags in rosbag2's older sqlite3 storage."""

import sqlite3
from contextlib import closing

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from support.foreign_bags import COUNT, ONE_TOPIC, check_whole

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings import BagWriter, read_recording


@pytest.fixture(params=[8, 9])
def folder(make, tmp_path, request):
    """A bag written by rosbags: version 9 embeds definitions, version 8 only names the types."""
    path = tmp_path / "bag"
    with Writer(path, version=request.param, storage_plugin=StoragePlugin.SQLITE3) as writer:
        channel = writer.add_connection(
            make.topic, "sensor_msgs/msg/JointState", typestore=make.store
        )
        for _, log_ns, payload in make.swing(COUNT):
            writer.write(channel, log_ns, payload)
    return path


def test_a_sqlite3_bag_is_read_with_and_without_its_metadata(folder):
    assert check_whole(folder) == ()
    (folder / "metadata.yaml").unlink()
    assert check_whole(folder) == ("no metadata.yaml",)
    (file,) = folder.iterdir()
    assert check_whole(file) == ()


def test_a_sqlite3_bag_can_be_copied_into_an_mcap_bag(folder, tmp_path):
    with BagWriter(tmp_path / "copy") as bag:
        bag.copy(folder)
    check_whole(tmp_path / "copy")


def test_a_sqlite3_file_that_is_cut_or_damaged_is_refused_with_what_recovers_it(folder):
    (file,) = folder.glob("*.db3")
    content = file.read_bytes()
    damaged = bytearray(content)
    at = content.index(b"motor", len(content) // 2) // 4096 * 4096
    damaged[at : at + 4096] = bytes(4096)
    cuts = [content[: len(content) * percent // 100] for percent in range(1, 100, 7)]
    for wrong in (*cuts, bytes(damaged), content.replace(b"TABLE messages", b"\xffABLE messages")):
        file.write_bytes(wrong)
        with pytest.raises(BagError, match=r"is damaged \(.*; `sqlite3 .*\.db3 \.recover` prints"):
            read_recording(file, ONE_TOPIC)


@pytest.mark.parametrize("stamp", [2**63 - 1, 1e300])
def test_stamps_that_no_clock_has_are_refused_in_one_line(folder, stamp):
    (file,) = folder.glob("*.db3")
    with closing(sqlite3.connect(file)) as connection:
        connection.execute(f"UPDATE messages SET timestamp = {stamp} WHERE id % 3 = 0")
        connection.commit()
    with pytest.raises(BagError, match="is not a bag stored as sqlite3"):
        read_recording(file, ONE_TOPIC)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "is empty"),
        (b"SQLite 2", "begins with"),
        (b"SQLite format 3\0" * 9, "is damaged"),
        (b"SQLite format 3\0", "is damaged"),
    ],
)
def test_a_file_that_is_no_database_is_refused_by_name(tmp_path, content, word):
    path = tmp_path / "a.db3"
    path.write_bytes(content)
    with pytest.raises(BagError, match=word) as caught:
        read_recording(path, ONE_TOPIC)
    assert str(path) in str(caught.value)


def test_a_database_of_something_else_is_refused_by_name(tmp_path):
    path = tmp_path / "a.db3"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE songs (title TEXT)")
        connection.commit()
    with pytest.raises(BagError, match="database missing tables"):
        read_recording(path, ONE_TOPIC)


def test_a_database_compressed_whole_says_how_to_undo_that(tmp_path):
    path = tmp_path / "a.db3.zstd"
    path.write_bytes(b"\x28\xb5\x2f\xfd")
    with pytest.raises(BagError, match="compressed sqlite3 bag: undo that first"):
        read_recording(path, ONE_TOPIC)
