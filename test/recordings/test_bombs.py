"""Small files that claim huge sizes give one line or the intact part, within bounds."""

import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from support.bombs import BOMBS
from support.foreign_bags import ONE_TOPIC, attempt

from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import read_messages
from cdrj_ros.recordings.writer import BagWriter

MOST_MEMORY = 500_000_000
"""Of what reading a file takes [bytes]."""
CUT = """
import os, sys
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import open_source
source = open_source(sys.argv[1])
os.truncate(sys.argv[1], os.path.getsize(sys.argv[1]) // 2)
read = read_recording(source, Topics("/joint_states", "/joint_states", ()))
print(read.motors["motor"].value.size, *read.notes)
"""


@pytest.mark.parametrize("name", BOMBS)
def test_a_small_file_that_claims_much_is_one_line_or_its_good_part(tmp_path, name):
    build, words = BOMBS[name]
    path = build(tmp_path)
    tracemalloc.start()
    try:
        read, refusal = attempt(lambda: read_recording(path, ONE_TOPIC))
        _, other = attempt(lambda: list(read_messages(path, ["/joint_states"])))
        assert tracemalloc.get_traced_memory()[1] < MOST_MEMORY
    finally:
        tracemalloc.stop()
    assert words in (" ".join(read.notes) if read else refusal)
    assert (refusal + other).isprintable()


@pytest.mark.parametrize("chunked", [True, False])
def test_a_file_that_is_cut_while_it_is_read_gives_what_comes_before(make, tmp_path, chunked):
    path = make.write_mcap(
        tmp_path / "a.mcap", make.swing(30_000), chunked=chunked, chunk_size=1 << 19
    )
    done = subprocess.run(
        [sys.executable, "-c", CUT, str(path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    count, notes = done.stdout.split(" ", 1)
    assert 10_000 < int(count) < 15_500
    assert "damaged" in notes or "no complete record" in notes


def test_reading_a_long_recording_takes_little_more_memory_than_its_data(tmp_path):
    count = 150_000
    stamps = np.arange(count, dtype=np.int64) * 1_000_000 + 1
    angles = np.random.default_rng(9).normal(size=(count, 1))
    with BagWriter(tmp_path / "bag") as bag:
        bag.write_joint_states("/motors", stamps, ["m"], angles)
        bag.write_joint_states("/joints", stamps, ["j"], angles)
    tracemalloc.start()
    try:
        read = read_recording(tmp_path / "bag", Topics("/motors", "/joints", ()))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    arrays = [(s.stamp_ns, s.log_ns, s.value) for s in (read.motors["m"], read.joints["j"])]
    held = sum(array.nbytes for three in arrays for array in three)
    assert held == 6 * 8 * count
    assert peak < 2.5 * held
