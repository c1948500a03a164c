"""Bags in every state: compressed, split, without index or metadata, damaged, truncated."""

import numpy as np
import pytest
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.writer import CompressionType
from support.foreign_bags import COUNT, ONE_TOPIC, attempt, check_whole

from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings.recording import read_recording
from cdrj_ros.recordings.source import read_messages


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_compressed_chunks_or_none_indexed_or_not(make, tmp_path, compression, indexed, chunked):
    path = make.write_mcap(
        tmp_path / "a.mcap",
        make.swing(COUNT),
        compression=compression,
        indexed=indexed,
        chunked=chunked,
    )
    expected = () if indexed or not chunked else ("a.mcap has no index; read from start to end",)
    assert check_whole(path) == expected


def split_bag(make, folder, parts):
    folder.mkdir()
    for i in range(parts):
        part = make.swing(COUNT)[i * COUNT // parts : (i + 1) * COUNT // parts]
        make.write_mcap(folder / f"{folder.name}_{i}.mcap", part)
    return folder


def test_parts_are_joined_in_order_of_their_number_and_what_is_missing_is_noted(make, tmp_path):
    folder = split_bag(make, tmp_path / "bag", 12)
    (folder / "metadata.yaml").write_text("{")  # is not needed
    assert check_whole(folder) == ()
    for i in (0, 7):
        (folder / f"bag_{i}.mcap").unlink()
    read = read_recording(folder, ONE_TOPIC)
    assert read.notes == ("2 of the files bag_0 to bag_11 are missing",)
    assert read.motors["motor"].value.size == COUNT * 10 // 12


def test_a_part_that_cannot_be_read_is_left_out_with_the_reason(make, tmp_path):
    folder = split_bag(make, tmp_path / "bag", 3)
    (folder / "bag_1.mcap").write_bytes(b"")
    read = read_recording(folder, ONE_TOPIC)
    (note,) = read.notes
    assert note.endswith("bag_1.mcap is empty, expected an MCAP file")
    assert read.motors["motor"].value.size == COUNT * 2 // 3


def test_of_several_recordings_in_a_folder_the_one_named_after_it_is_read(make, tmp_path):
    folder = split_bag(make, tmp_path / "bag", 2)
    make.write_mcap(folder / "other.mcap", make.swing(5))
    assert check_whole(folder) == ("other recordings in the folder were left out: other",)
    folder = folder.rename(tmp_path / "renamed")
    with pytest.raises(BagError, match=r"holds 2 recordings \(bag, other\): name one"):
        read_recording(folder, ONE_TOPIC)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "is empty"),
        (b"#ROSBAG V2.0\n", "not an MCAP file: it begins with b'#ROSBAG"),
        (b"\x89MCA", "not an MCAP file"),
        (b"\x28\xb5\x2f\xfd" + b"\xff" * 40, r"compressed as a whole; `zstd -d .*` unpacks it"),
        (b"SQLite format 3\0" * 9, r"`rosbags-convert --src .* --dst-storage mcap` makes an MCAP"),
        (b"\x89MCAP0\r\n", "holds no messages"),
        (b"\x89MCAP0\r\n" + bytes(500), "holds no messages"),
    ],
)
def test_files_that_are_not_bags_are_refused_by_name(tmp_path, content, word):
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(BagError, match=word) as caught:
        read_recording(path, ONE_TOPIC)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def check_prefix(path, whole):
    """Check that a truncated bag gives the beginning of the complete one; returns its length."""
    read, refusal = attempt(lambda: read_recording(path, ONE_TOPIC))
    if read is None:
        assert str(path) in refusal
        return 0
    n = read.motors["motor"].value.size
    for name, series in {**read.motors, **read.references}.items():
        uncut = {**whole.motors, **whole.references}[name]
        np.testing.assert_array_equal(series.value, uncut.value[:n])
        np.testing.assert_array_equal(series.stamp_ns, uncut.stamp_ns[:n])
    assert read.malformed == {"/joint_states": 0}
    assert len(list(read_messages(path, ["/joint_states"]))) == n
    assert any("cut" in note and f"read {n} messages" in note for note in read.notes)
    return n


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_bag_cut_anywhere_gives_all_that_is_intact(make, tmp_path, compression):
    path = make.write_mcap(
        tmp_path / "whole.mcap", make.swing(500), compression=compression, chunk_size=1_000
    )
    whole, content = read_recording(path, ONE_TOPIC), path.read_bytes()
    cut = tmp_path / "cut.mcap"
    percents, counts = range(0, 100, 3), []
    for percent in percents:
        cut.write_bytes(content[: len(content) * percent // 100])
        counts.append(check_prefix(cut, whole))
    assert counts == sorted(counts)
    assert counts[0] == 0
    if compression == CompressionType.NONE:
        for percent, count in zip(percents, counts, strict=True):
            assert count >= 500 * (percent - 8) / 100 or percent >= 80


@pytest.mark.parametrize("claims", [False, True])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_chunk_that_is_damaged_is_left_out_and_noted(make, tmp_path, compression, claims):
    """One byte fails its checksum; or its records claim more bytes than a number of them can be."""
    path = make.write_mcap(tmp_path / "a.mcap", make.swing(COUNT), compression=compression)
    content = bytearray(path.read_bytes())
    if claims:
        with path.open("rb") as stream:
            chunk = make_reader(stream).get_summary().chunk_indexes[1]
        size = chunk.chunk_start_offset + 1 + 8 + 3 * 8 + 4 + 4 + len(chunk.compression)
        content[size : size + 8] = b"\xff" * 8
    else:
        content[len(content) // 3] ^= 0xFF
    path.write_bytes(content)
    read = read_recording(path, ONE_TOPIC)
    assert any("left out" in note for note in read.notes)
    values = read.motors["motor"].value
    assert COUNT / 2 < values.size < COUNT
    assert np.isin(values, np.arange(COUNT)).all()


def test_an_index_that_leaves_out_a_chunk_is_not_trusted(make, tmp_path):
    path = make.write_mcap(tmp_path / "a.mcap", make.swing(COUNT))
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    content = path.read_bytes()
    builder = RecordBuilder()
    summary.chunk_indexes[3].write(builder)
    at = content.index(builder.end())
    damaged = bytearray(content)
    damaged[at] = 0x80  # a record of a private kind, which readers skip
    path.write_bytes(damaged)
    assert check_whole(path) == ("a.mcap has no index; read from start to end",)


def test_folders_that_are_not_bags_are_refused_by_name(tmp_path):
    with pytest.raises(BagError, match=r"holds no \.mcap file"):
        read_recording(tmp_path)
    for name in ("bag_0.db3", "bag_0.db3.zstd"):
        (tmp_path / name).write_bytes(b"SQLite format 3\0")
    with pytest.raises(BagError, match=r"no readable file.*bag_0\.db3 is a bag stored as sqlite3"):
        read_recording(tmp_path)
