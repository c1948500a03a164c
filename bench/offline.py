"""Time of ``validate`` on a long recording, compared with deserialisation by rosbags."""

from __future__ import annotations

import contextlib
import io
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bench.figures import BAG, ROBOT, Row, compared, seconds, turns
from cdrj_ros.commands import validate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Recording, Topics, read_recording
from cdrj_ros.recordings.writer import BagWriter

DURATION_S = 200
ROUNDS = 3
MESSAGES_S = 45.0
"""Time for the rounds with mcap."""


def prolonged(series: Series, begin_ns: int, end_ns: int) -> Series:
    """The series repeated forwards and backwards; every pass begins where the previous one ends."""
    span = end_ns - begin_ns
    passes = -(-DURATION_S * 1_000_000_000 // span)
    logs: list[Any] = []
    stamps: list[Any] = []
    values: list[Any] = []
    for k in range(passes):
        there = k % 2 == 0
        for times, into in ((series.log_ns, logs), (series.stamp_ns, stamps)):
            since = times - begin_ns if there else (end_ns - times)[::-1]
            into.append(begin_ns + k * span + since)
        values.append(series.value if there else series.value[::-1])
    log, stamp, value = (np.concatenate(parts) for parts in (logs, stamps, values))
    kept = log < begin_ns + DURATION_S * 1_000_000_000
    kept[1:] &= stamp[1:] > stamp[:-1]
    return Series(stamp[kept], log[kept], value[kept])


def _columns(channels: Mapping[str, Series], prefix: str, recording: Recording) -> dict[str, Any]:
    """Arguments of a ``BagWriter.write_…`` method for the channels of one topic."""
    longer = {
        name.removeprefix(prefix): prolonged(series, recording.start_ns, recording.end_ns)
        for name, series in channels.items()
        if name.startswith(prefix)
    }
    first = next(iter(longer.values()))
    return {
        "stamp_ns": first.stamp_ns,
        "log_ns": first.log_ns,
        "names": tuple(longer),
        "values": np.stack([series.value for series in longer.values()], axis=1),
    }


def write_long_bag(path: Path, recording: Recording) -> None:
    """Write the sample recording, prolonged to ``DURATION_S``."""
    topics = Topics()

    def given(channels: Mapping[str, Series], prefix: str, array: str) -> dict[str, Any]:
        columns = _columns(channels, prefix, recording)
        columns[array] = columns.pop("values")
        return columns

    with BagWriter(path) as bag:
        bag.write_joint_states(topics.motors, **given(recording.motors, "", "position"))
        bag.write_joint_states(topics.joints, **given(recording.joints, "", "position"))
        tensions, forces, efforts = topics.references
        bag.write_tensions(tensions, **given(recording.references, "tension/", "tension"))
        bag.write_nodal_forces(forces, **given(recording.references, "nodal_force/", "magnitude"))
        bag.write_joint_states(efforts, **given(recording.references, "effort/", "effort"))


def deserialise(path: Path) -> tuple[float, float]:
    """Time [s] that rosbags needs to read all messages, and to deserialise them."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        raw: list[Any] = []
        reading = seconds(lambda: raw.extend(reader.messages()))

        def decode_all() -> None:
            for connection, _, payload in raw:
                reader.deserialize(payload, connection.msgtype)

        return reading, seconds(decode_all)


def _quietly(arguments: list[str]) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        validate.main(arguments)


def measure() -> list[Row]:
    """Seconds for a bag of ``DURATION_S``."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "long")
        recording = read_recording(BAG)
        write_long_bag(path, recording)
        return _measure(path, Path(folder, "figures.json"))


def _measure(path: Path, figures: Path) -> list[Row]:
    model = load_model(str(ROBOT))
    arguments = [str(path), "--robot", str(ROBOT), "--json", str(figures)]
    recording = read_inputs(str(path), Topics(), model)
    conditioned = condition_recording(model, recording)
    if any(conditioned.refused.values()):
        raise RuntimeError(f"the prolonged bag is not clean: {dict(conditioned.refused)}")
    _quietly(arguments)
    whole, process, reading, decoded, both = ([] for _ in range(5))
    command = [sys.executable, "-c", "from cdrj_ros.commands.entry import validate; validate()"]
    for _ in turns(ROUNDS, MESSAGES_S):
        whole.append(seconds(lambda: _quietly(arguments)))
        taken, deserialised = deserialise(path)
        decoded.append(deserialised)
        both.append(taken + deserialised)
        reading.append(seconds(lambda: read_inputs(str(path), Topics(), model)))
        process.append(
            seconds(
                lambda: subprocess.run(
                    [*command, *arguments], check=True, stdout=subprocess.DEVNULL
                )
            )
        )
    bag, alone = f"{DURATION_S} s bag", "rosbags: deserialising alone"
    both_of = "rosbags: reading and deserialising"
    return [
        compared(
            f"validate, {bag}, all but the process's start", "s", whole, alone, decoded, "< 1"
        ),
        compared("validate as a command, from its start", "s", process, alone, decoded, "≤ 0.3"),
        compared("reading and decoding alone", "s", reading, both_of, both),
    ]
