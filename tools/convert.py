#!/usr/bin/env python3
"""Convert foreign recordings to bags.

    git clone https://github.com/MRDLab/mis-tool-characterization
    python tools/convert.py davinci mis-tool-characterization/data/Tool_4_Maryland_L_4 --out BAGS

da Vinci instruments with two torque sensors.  Source: GitHub MRDLab/mis-tool-characterization
(commit 03658b2), Open Database License 1.0, its contents Database Contents License 1.0; O'Neill,
Stephens, Kowalewski, IEEE RA-L 3(4), 2018, doi 10.1109/LRA.2018.2849862.  Units are those of its
readme.  A folder holds one instrument in one mounting or pose, a file one run.  The bag of
`Tool_4_Maryland_L_4/11.TXT` is `Tool_4_Maryland_L_4_11`.  Rows are 1 ms apart; their time is that
of the messages, from an arbitrary beginning.

`Back-end CUI Encoder` [8192 counts per turn]
    `/cdrj/motor_states`, `spindle` [rad].
`Front-end Maxon Encoder` [4000 counts per turn]
    `/cdrj/joint_states`, `jaw` [rad].
`Back-end Futek Torque`, `Front-end Futek Torque` [0.000039811 N m per count]
    `/reference/efforts`, `spindle` and `jaw` [N m].

The other columns, currents and commands, are left out.

    git clone https://github.com/DaeyunJang/LSTM-force-estimation
    python tools/convert.py continuum LSTM-force-estimation/datasets --out BAGS

A wire-driven continuum instrument with two load cells.  Source: GitHub
DaeyunJang/LSTM-force-estimation, folder `datasets` (15 November 2024, commit dcb11bf).  The
repository states no licence for its data, so they are not part of this project, and neither are the
bags.  Column meanings and dimensions are those of the software that drove the instrument and wrote
the files, DaeyunJang/Hyper-Redundant-Manipulator (Apache-2.0, commit 726b06f): `src/record_pkg`,
`control_node.cpp`, `hw_definition.hpp`, `force_loadcell_echo_UNO.ino`.

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

import argparse
import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter

from cdrj_ros.foundation.errors import BagError, CdrjError
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter

TOPICS = Topics()
TENSIONS, EFFORTS = "/reference/tensions", "/reference/efforts"

TIME, SPINDLE, SPINDLE_TORQUE, JAW, JAW_TORQUE, COLUMNS = 0, 1, 2, 4, 5, 10
RADIANS = {SPINDLE: 2.0 * np.pi / 8192.0, JAW: 2.0 * np.pi / 4000.0}
"""Per count, by column."""
NEWTON_METRES = 3.9811e-5
"""Per count of both torque sensors."""
BEGIN_NS = 1_500_000_000_000_000_000

COUNTS_PER_TURN = 51 * 4 * 1024
"""GEAR_RATIO, ENCODER_CHANNEL and ENCODER_RESOLUTION of hw_definition.hpp."""
STANDARD_GRAVITY = 9.80665
"""Newtons per kilogram-force."""
WIRES = ("wire_0", "wire_1")
SEGMENTS = tuple(f"segment_{k}" for k in range(1, 9))
NEIGHBOURS = 11
MISREADING = 1.5
"""Difference from the median of NEIGHBOURS rows [N]."""


def davinci_runs(folder):
    """All runs of a folder."""
    return sorted(path for path in folder.glob("*.TXT") if path.stem.isdigit())


def read_davinci(path):
    """Rows of a run, shape (n, COLUMNS).

    Raises:
        BagError: it is not such a file, or its time does not increase.
    """
    try:
        rows = np.loadtxt(path, delimiter=",", comments="%", ndmin=2)
    except (ValueError, UnicodeDecodeError) as error:
        raise BagError(f"{path}: {error}") from error
    if rows.shape[1] != COLUMNS or not np.all(np.isfinite(rows)):
        raise BagError(f"{path}: not rows of {COLUMNS} finite numbers")
    if not np.all(np.diff(rows[:, TIME]) > 0.0):
        raise BagError(f"{path}: its time does not increase")
    return rows


def convert_davinci(run, out):
    """Write the bag of one run; returns what it holds."""
    rows = read_davinci(run)
    stamps = BEGIN_NS + np.round(rows[:, TIME] * 1e9).astype(np.int64)
    angles = {column: rows[:, column : column + 1] * RADIANS[column] for column in RADIANS}
    torques = NEWTON_METRES * rows[:, (SPINDLE_TORQUE, JAW_TORQUE)]
    with BagWriter(out / f"{run.parent.name}_{run.stem}") as bag:
        bag.write_joint_states(TOPICS.motors, stamps, ["spindle"], angles[SPINDLE])
        bag.write_joint_states(TOPICS.joints, stamps, ["jaw"], angles[JAW])
        bag.write_joint_states(EFFORTS, stamps, ["spindle", "jaw"], effort=torques)
    return str(bag.path)


def continuum_runs(folder):
    """All runs below a folder."""
    return sorted(one for one in folder.rglob("data_*.csv") if "_LPF_" not in one.name)


def convert_continuum(data, out):
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
    name = re.sub(r"[^\w+-]+", "_", label, flags=re.ASCII).strip("_")
    with BagWriter(out / data.parent.name / name) as bag:
        screws = counts * (2.0 * np.pi / COUNTS_PER_TURN)
        bag.write_joint_states(TOPICS.motors, stamp_ns, WIRES, screws)
        bag.write_joint_states(TOPICS.joints, stamp_ns[seen], SEGMENTS, segments)
        for k, wire in enumerate(WIRES):
            own = right[:, k]
            bag.write_tensions(TENSIONS, stamp_ns[own], [f"{wire}/1"], tension[own, k : k + 1])
    seconds = (stamp_ns[-1] - stamp_ns[0]) * 1e-9
    misread = np.count_nonzero(~right)
    return f"{bag.path}: {len(rows)} images, {seconds:.0f} s, {misread} misreadings"


SOURCES = {
    "davinci": (davinci_runs, convert_davinci),
    "continuum": (continuum_runs, convert_continuum),
}
"""How the runs of a source are found, and converted."""


def main():
    """Convert every run of the folders; exit code 2 where one cannot be read."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("source", choices=SOURCES)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="of the source")
    parser.add_argument("--out", type=Path, required=True, help="folder of the bags")
    asked = parser.parse_args()
    find, convert = SOURCES[asked.source]
    try:
        for folder in asked.folders:
            if not (runs := find(folder)):
                raise BagError(f"{folder} holds no run")
            for run in runs:
                print(convert(run, asked.out))
    except (CdrjError, OSError) as error:
        print(f"convert: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
