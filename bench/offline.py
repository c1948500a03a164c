"""Time of ``validate`` on a long recording beside rosbags, and of a fit to it."""

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

from bench.figures import BAG, ROBOT, Row, alone, compared, seconds, turns
from cdrj_ros.commands import validate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Recording, Topics, read_recording
from cdrj_ros.recordings.writer import BagWriter

DURATION_S = 200
ROUNDS = 3
MESSAGES_S = 45.0
"""Time for the rounds of ``validate``."""
FIT_S = 40.0
"""Time for the rounds of ``identify``."""
EIGHT = "rho,preload,EA,f_d"
"""Numbers to fit: four keys with a number for each of the prototype's two cables."""


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


def deserialise(path: Path) -> float:
    """Time [s] that rosbags needs to deserialise all messages, once it has read them."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        raw = list(reader.messages())

        def decode_all() -> None:
            for connection, _, payload in raw:
                reader.deserialize(payload, connection.msgtype)

        return seconds(decode_all)


def _quietly(arguments: list[str]) -> None:
    with contextlib.redirect_stdout(io.StringIO()):
        validate.main(arguments)


def _run(command: str, arguments: list[str]) -> float:
    """Time of a command from its start [s]."""
    program = f"from cdrj_ros.commands.entry import {command}; {command}()"
    given = [sys.executable, "-c", program, *arguments]
    return seconds(lambda: subprocess.run(given, check=True, stdout=subprocess.DEVNULL))


def measure() -> list[Row]:
    """Seconds for a bag of ``DURATION_S``."""
    with TemporaryDirectory() as folder:
        path = Path(folder, "long")
        write_long_bag(path, read_recording(BAG))
        given = [str(path), "--robot", str(ROBOT)]
        model = load_model(str(ROBOT))
        conditioned = condition_recording(model, read_inputs(str(path), Topics(), model))
        if any(conditioned.refused.values()):
            raise RuntimeError(f"the prolonged bag is not clean: {dict(conditioned.refused)}")
        whole, process, decoded = [], [], []
        _quietly(given)
        for _ in turns(ROUNDS, MESSAGES_S):
            whole.append(seconds(lambda: _quietly(given)))
            decoded.append(deserialise(path))
            process.append(_run("validate", given))
        fits = [_run("identify", [*given, "--fit", EIGHT]) for _ in turns(ROUNDS, FIT_S)]
    bag, beside = f"{DURATION_S} s bag", "rosbags: deserialising alone"
    what = f"validate, {bag}, all but the process's start"
    command = "validate as a command, from its start"
    return [
        compared(what, "s", whole, beside, decoded, "< 1"),
        compared(command, "s", process, beside, decoded, "≤ 0.3"),
        alone(f"identify, eight numbers, {bag}", "s", fits, "< 12"),
    ]
