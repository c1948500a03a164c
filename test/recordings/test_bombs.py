"""Small files that claim huge sizes give one line or the intact part, within bounds."""

import json
import os
import resource
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest
from support.bombs import BOMBS

from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.writer import BagWriter

MOST_MEMORY = 1_500_000_000
"""Address space of the process that reads all files [bytes]; the libraries take half of it."""
MOST_FILE = 300_000_000
"""Size of the largest file that it may write [bytes]."""
MOST_SECONDS = 120
"""Time limit in case the process never ends; normally it takes a few seconds."""
READER = """
import json, sys
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import read_messages
from cdrj_ros.foundation.errors import BagError

def outcome(read):
    try:
        return read()
    except BagError as error:
        return str(error)
    except BaseException as error:
        return f"{type(error).__name__} {error}\\n"

def numbers(path):
    read = read_recording(path, Topics("/joint_states", "/joint_states", ()))
    count = sum(series.value.size for series in read.motors.values())
    return " ".join([f"read {count} values", *read.notes])

for path in sys.argv[1:]:
    ways = (
        lambda: numbers(path),
        lambda: f"{sum(1 for _ in read_messages(path, ['/joint_states']))} messages",
    )
    print(json.dumps([outcome(read) for read in ways]), flush=True)
"""
CUT = """
import os, sys
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.source import open_source
source = open_source(sys.argv[1])
os.truncate(sys.argv[1], os.path.getsize(sys.argv[1]) // 2)
read = read_recording(source, Topics("/joint_states", "/joint_states", ()))
print(read.motors["motor"].value.size, *read.notes)
"""


def limit_resources() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_FILE, MOST_FILE))


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory):
    """Output of a process with limited resources for every file, read in three ways."""
    paths = {}
    for name, (build, _) in BOMBS.items():
        paths[name] = build(tmp_path_factory.mktemp("bomb"))
    done = subprocess.run(
        [sys.executable, "-c", READER, *map(str, paths.values())],
        preexec_fn=limit_resources,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"},
        capture_output=True,
        text=True,
        timeout=MOST_SECONDS,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return dict(zip(paths, map(json.loads, done.stdout.splitlines()), strict=True))


@pytest.mark.parametrize("name", BOMBS)
def test_a_small_file_that_claims_much_is_one_line_or_its_good_part(outcomes, name):
    words = BOMBS[name][1]
    assert words in outcomes[name][0]
    for text in outcomes[name]:
        assert text.isprintable()


@pytest.mark.parametrize("chunked", [True, False])
def test_a_file_that_is_cut_while_it_is_read_gives_what_comes_before(make, tmp_path, chunked):
    path = make.mcap(tmp_path / "a.mcap", make.swing(30_000), chunked=chunked, chunk_size=1 << 19)
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
