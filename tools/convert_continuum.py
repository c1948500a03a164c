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
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from cdrj_ros.foundation.errors import BagError, CdrjError
from cdrj_ros.recordings.writer import BagWriter

COUNTS_PER_TURN = 51 * 4 * 1024
"""GEAR_RATIO, ENCODER_CHANNEL and ENCODER_RESOLUTION of hw_definition.hpp."""
STANDARD_GRAVITY = 9.80665
"""Newtons per kilogram-force."""
WIRES = ("wire_0", "wire_1")
SEGMENTS = tuple(f"segment_{k}" for k in range(1, 9))
NEIGHBOURS = 11
MISREADING = 1.5
"""Difference from the median of NEIGHBOURS rows [N]."""


def convert(data: Path, folder: Path) -> str:
    """Write the bag of one `data_NAME.csv` and the joint angles beside it; returns what it holds.

    Raises:
        BagError: a column or an angle is missing or not a number, or the stamps go back.
    """
    label = data.stem.removeprefix("data_")
    entries = data.with_name(f"curve_fit_result-joint_angle_{label}.json")
    try:
        with data.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
        stamp_ns = np.array([int(row["sec"]) * 10**9 + int(row["nanosec"]) for row in rows])
        counts = np.array([[float(row[f"motor position #{k}"]) for k in (0, 1)] for row in rows])
        grams = np.array([[float(row[f"loadcell #{k}"]) for k in (0, 1)] for row in rows])
        angles = {
            entry["Image Filename"]: entry["Joint Angles Relative"]
            for entry in json.loads(entries.read_text(encoding="utf-8"))
        }
        seen = np.array([row["image"] in angles for row in rows])
        segments = np.array([angles[row["image"]] for row in rows if row["image"] in angles], float)
    except (KeyError, TypeError, ValueError) as error:
        raise BagError(f"{data} or {entries.name}: {error!r}") from None
    if segments.shape[1:] != (len(SEGMENTS),) or not np.isfinite(segments).all():
        raise BagError(f"{entries}: not {len(SEGMENTS)} numbers for every image")
    if (np.diff(stamp_ns) <= 0).any():
        raise BagError(f"{data}: the times in sec and nanosec must increase")
    tension = grams * (1e-3 * STANDARD_GRAVITY)
    usual = median_filter(tension, size=(NEIGHBOURS, 1), mode="nearest")
    right = np.abs(tension - usual) <= MISREADING
    with BagWriter(folder / re.sub(r"[^\w+-]+", "_", label, flags=re.ASCII).strip("_")) as bag:
        screws = counts * (2.0 * np.pi / COUNTS_PER_TURN)
        bag.write_joint_states("/cdrj/motor_states", stamp_ns, WIRES, screws)
        bag.write_joint_states("/cdrj/joint_states", stamp_ns[seen], SEGMENTS, segments)
        for k, wire in enumerate(WIRES):
            own = right[:, k]
            bag.write_tensions(
                "/reference/tensions", stamp_ns[own], [f"{wire}/1"], tension[own, k : k + 1]
            )
    seconds = (stamp_ns[-1] - stamp_ns[0]) * 1e-9
    misread = np.count_nonzero(~right)
    return f"{bag.path}: {len(rows)} images, {seconds:.0f} s, {misread} misreadings"


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
            print(convert(data, asked.out / data.parent.name))
    except (CdrjError, OSError) as error:
        print(f"convert_continuum: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
