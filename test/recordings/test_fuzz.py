"""Any damaged file gives a one-line error or its intact part, in bounded time and memory.

``make soak`` sets CDRJ_DAMAGES and tries more.
"""

import os
import struct
import tracemalloc
from time import process_time

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from support.foreign_bags import ONE_TOPIC, attempt

from cdrj_ros.recordings.recording import read_recording
from cdrj_ros.recordings.source import read_messages

COUNT = 40
SOAKED = "CDRJ_DAMAGES" in os.environ
MOST_MEMORY = 300e6
"""Memory for files of a few kilobytes [bytes]."""
MOST_SECONDS = 5.0
"""Limit of processor time, which excludes other work on the machine."""
NOT_MEANT = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]


@pytest.fixture(scope="module")
def originals(make, tmp_path_factory):
    """Undamaged files of one recording, by kind."""
    folder = tmp_path_factory.mktemp("whole")
    files = {}
    for compression in CompressionType:
        for chunked in (True, False):
            path = make.write_mcap(
                folder / "a.mcap",
                make.swing(COUNT),
                compression=compression,
                chunked=chunked,
                chunk_size=1500,
            )
            files[f"{compression.name}-{chunked}.mcap"] = path.read_bytes()
    path = make.write_mcap(
        folder / "a.mcap", make.swing(COUNT), compression=CompressionType.LZ4, chunk_size=1500,
        indexed=False,
    )  # fmt: skip
    files["unindexed.mcap"] = path.read_bytes()
    return files


def read_every_way(path):
    """Read the file in every way; only a one-line BagError is allowed, within the time limit."""
    begin = process_time()
    for read in (
        lambda: read_recording(path, ONE_TOPIC),
        lambda: list(read_messages(path, ["/joint_states"])),
    ):
        refusal = attempt(read)[1]
        assert "\n" not in refusal
        assert not refusal or str(path) in refusal
    assert process_time() - begin < MOST_SECONDS


WORDS = st.sampled_from([0, 1, 2**8 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1])


@st.composite
def damages(draw):
    """A function that damages a file in one to four places and may truncate it."""
    places = draw(st.lists(st.floats(0.0, 1.0, exclude_max=True), min_size=1, max_size=4))
    kinds = draw(st.lists(st.sampled_from(["byte", "word", "insert", "remove"]), min_size=4))
    words = draw(st.lists(WORDS, min_size=4, max_size=4))
    garbage = draw(st.binary(min_size=1, max_size=40))
    cut = draw(st.one_of(st.just(1.0), st.floats(0.0, 1.0)))

    def damage(content):
        data = bytearray(content)
        for place, kind, word in zip(places, kinds, words, strict=False):
            at = int(place * len(data))
            if kind == "byte":
                data[at] = (data[at] + 1 + word % 255) % 256
            elif kind == "word":
                data[at : at + 8] = struct.pack("<Q", word)
            elif kind == "insert":
                data[at:at] = garbage
            else:
                del data[at : at + len(garbage)]
        return bytes(data[: int(cut * len(data))])

    return damage


@settings(max_examples=600 if SOAKED else 60, suppress_health_check=NOT_MEANT)
@given(damage=damages(), data=st.data())
def test_no_damage_gives_more_than_one_clear_line(originals, tmp_path, damage, data):
    name = data.draw(st.sampled_from(sorted(originals)))
    path = tmp_path / name
    path.write_bytes(damage(originals[name]))
    tracemalloc.start()
    try:
        read_every_way(path)
        assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    finally:
        tracemalloc.stop()
