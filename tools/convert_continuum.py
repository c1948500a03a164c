#!/usr/bin/env python3
"""Convert recordings of a wire-driven continuum instrument with two load cells to bags.

    git clone https://github.com/DaeyunJang/LSTM-force-estimation
    python tools/convert_continuum.py LSTM-force-estimation/datasets --out BAGS

Source: GitHub DaeyunJang/LSTM-force-estimation, folder `datasets` (15 November 2024, commit
dcb11bf).  The repository states no licence for its data, so they are not part of this project, and
neither are the bags.  Column meanings and dimensions are those of the software that drove the
instrument and wrote the files, DaeyunJang/Hyper-Redundant-Manipulator (Apache-2.0, commit 726b06f):
`src/record_pkg`, `control_node.cpp`, `hw_definition.hpp`, `force_loadcell_echo_UNO.ino`.

A recording is `data_NAME.csv`, one row per camera image (30 Hz), and
`curve_fit_result-joint_angle_NAME.json`, one entry per image.  `data_LPF_NAME.csv` repeats the
former with a filtered external force and is not used.

`sec`, `nanosec` [s, ns]
    Header stamps and log times of all messages.
`motor position #0`, `#1` [51 * 4 * 1024 counts per turn of the ball screw]
    `/cdrj/motor_states`, `wire_0` and `wire_1` [rad].  A turn is 2 mm of wire; positive pulls.
`Joint Angles Relative` [rad]
    `/cdrj/joint_states`, `segment_1` (base) to `segment_8` (tip), from the camera.
`loadcell #0`, `#1` [gram-force, tared before the experiments]
    `/reference/tensions`, `wire_0/1` and `wire_1/1` [N].  The amplifier renews them at about 10 Hz.

The external force (`fx` to `tz`) and the images are left out.  An image without an entry has no
joint angles in the bag.  The amplifier misreads now and then, by up to 25 N for one reading, which
fills three or four rows: what differs by more than 1.5 N from the median of the eleven rows about
it is left out, and counted in what the program prints.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from cdrj_ros.foundation.errors import BagError, CdrjError
from cdrj_ros.recordings.writer import BagWriter

COUNTS_PER_TURN = 51 * 4 * 1024
"""GEAR_RATIO, ENCODER_CHANNEL and ENCODER_RESOLUTION of hw_definition.hpp."""
STANDARD_GRAVITY = 9.80665
"""Newtons per kilogram-force."""
WIRES = ("wire_0", "wire_1")
SEGMENTS = tuple(f"segment_{k}" for k in range(1, 9))
COLUMNS = (
    "sec",
    "nanosec",
    "image",
    "motor position #0",
    "motor position #1",
    "loadcell #0",
    "loadcell #1",
)
NEIGHBOURS = 11
MISREADING = 1.5
"""Difference from the median of NEIGHBOURS rows [N]."""

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """One recording in SI units; n images, of which m have joint angles."""

    name: str
    stamp_ns: npt.NDArray[np.int64]
    """Shape (n,)."""
    screw_angle: Floats
    """Shape (n, 2) [rad]."""
    seen: npt.NDArray[np.bool_]
    """Shape (n,): whether the image has joint angles."""
    segment_angle: Floats
    """Shape (m, 8) [rad]."""
    tension: Floats
    """Shape (n, 2) [N]."""

    def misread(self) -> npt.NDArray[np.bool_]:
        """Readings of the cells far from those about them, shape (n, 2)."""
        usual = median_filter(self.tension, size=(NEIGHBOURS, 1), mode="nearest")
        return np.asarray(np.abs(self.tension - usual) > MISREADING)


def read_recording(data: Path) -> Recording:
    """Read one `data_NAME.csv` and the joint angles beside it.

    Raises:
        BagError: a file, a column or an angle is missing or not a number, or the stamps go back.
    """
    rows = _rows(data)
    angles = _angles(data.with_name(f"curve_fit_result-joint_angle_{_label(data)}.json"))
    try:
        stamps = [int(row["sec"]) * 10**9 + int(row["nanosec"]) for row in rows]
        counts = [[float(row[f"motor position #{k}"]) for k in (0, 1)] for row in rows]
        grams = [[float(row[f"loadcell #{k}"]) for k in (0, 1)] for row in rows]
    except (TypeError, ValueError) as error:
        raise BagError(f"{data}: a column holds something other than a number: {error}") from None
    stamp_ns = np.array(stamps, np.int64)
    if (np.diff(stamp_ns) <= 0).any():
        raise BagError(f"{data}: the times in sec and nanosec must increase")
    seen = np.array([row["image"] in angles for row in rows])
    found = [angles[row["image"]] for row in rows if row["image"] in angles]
    if not found:
        raise BagError(f"{data}: no image of it has joint angles in the JSON file beside it")
    return Recording(
        name=re.sub(r"[^\w+-]+", "_", _label(data), flags=re.ASCII).strip("_"),
        stamp_ns=stamp_ns,
        screw_angle=np.array(counts) * (2.0 * np.pi / COUNTS_PER_TURN),
        seen=seen,
        segment_angle=np.array(found),
        tension=np.array(grams) * (1e-3 * STANDARD_GRAVITY),
    )


def write_bag(recording: Recording, folder: Path) -> tuple[Path, int]:
    """Write the bag `folder/NAME`; return its path and the number of misreadings left out."""
    stamp_ns, misread = recording.stamp_ns, recording.misread()
    with BagWriter(folder / recording.name) as bag:
        bag.write_joint_states("/cdrj/motor_states", stamp_ns, WIRES, recording.screw_angle)
        bag.write_joint_states(
            "/cdrj/joint_states", stamp_ns[recording.seen], SEGMENTS, recording.segment_angle
        )
        for k, wire in enumerate(WIRES):
            right = ~misread[:, k]
            tension = recording.tension[right, k : k + 1]
            bag.write_tensions("/reference/tensions", stamp_ns[right], [f"{wire}/1"], tension)
        return bag.path, int(misread.sum())


def _label(data: Path) -> str:
    return data.stem.removeprefix("data_")


def _rows(data: Path) -> list[dict[str, str]]:
    with data.open(encoding="utf-8", newline="") as stream:
        reader = csv.DictReader(stream)
        missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
        if missing:
            raise BagError(f"{data}: the columns {', '.join(missing)} are missing")
        rows = list(reader)
    if not rows:
        raise BagError(f"{data}: has no rows")
    return rows


def _angles(path: Path) -> dict[str, list[float]]:
    """Joint angles by image name [rad]."""
    if not path.is_file():
        raise BagError(f"{path} is missing: it holds the joint angles")
    entries: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
    angles = {entry["Image Filename"]: entry.get("Joint Angles Relative") for entry in entries}
    for image, values in angles.items():
        if values is None or len(values) != len(SEGMENTS) or not np.isfinite(values).all():
            raise BagError(
                f"{path}: 'Joint Angles Relative' of {image} must be {len(SEGMENTS)} numbers, "
                f"got {values}"
            )
    return angles


def main() -> int:
    """Convert every recording of the folders; exit code 2 where one cannot be read."""
    parser = argparse.ArgumentParser(description="Convert recordings of a continuum instrument.")
    parser.add_argument("datasets", type=Path, help="the source's folder with train and test")
    parser.add_argument("--out", type=Path, required=True, help="folder of the bags")
    asked = parser.parse_args()
    found = sorted(
        path for path in asked.datasets.rglob("data_*.csv") if not path.name.startswith("data_LPF_")
    )
    try:
        if not found:
            raise BagError(f"{asked.datasets} holds no file data_*.csv")
        for data in found:
            recording = read_recording(data)
            path, misread = write_bag(recording, asked.out / data.parent.name)
            seconds = (recording.stamp_ns[-1] - recording.stamp_ns[0]) * 1e-9
            images = len(recording.stamp_ns)
            print(f"{path}: {images} images, {seconds:.0f} s, {misread} misreadings")
    except (CdrjError, OSError) as error:
        print(f"convert_continuum: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
