#!/usr/bin/env python3
"""Convert recordings of da Vinci instruments with two torque sensors to bags.

    git clone https://github.com/MRDLab/mis-tool-characterization
    python tools/convert_davinci.py mis-tool-characterization/data/Tool_4_Maryland_L_4 --out BAGS

Source: GitHub MRDLab/mis-tool-characterization (commit 03658b2), Open Database License 1.0, its
contents Database Contents License 1.0; O'Neill, Stephens, Kowalewski, IEEE RA-L 3(4), 2018, doi
10.1109/LRA.2018.2849862.  Units are those of its readme.

A folder holds one instrument in one mounting or pose, a file one run.  The bag of
`Tool_4_Maryland_L_4/11.TXT` is `Tool_4_Maryland_L_4_11`.  Rows are 1 ms apart; their time is that
of the messages, from an arbitrary beginning.

`Back-end CUI Encoder` [8192 counts per turn]
    `/cdrj/motor_states`, `spindle` [rad].
`Front-end Maxon Encoder` [4000 counts per turn]
    `/cdrj/joint_states`, `jaw` [rad].
`Back-end Futek Torque`, `Front-end Futek Torque` [0.000039811 N m per count]
    `/reference/efforts`, `spindle` and `jaw` [N m].

The other columns, currents and commands, are left out.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import BagError, CdrjError
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.recordings.writer import BagWriter

TIME, SPINDLE, SPINDLE_TORQUE, JAW, JAW_TORQUE, COLUMNS = 0, 1, 2, 4, 5, 10
RADIANS: Final = {SPINDLE: 2.0 * np.pi / 8192.0, JAW: 2.0 * np.pi / 4000.0}
"""Per count, by column."""
NEWTON_METRES: Final = 3.9811e-5
"""Per count of both torque sensors."""
BEGIN_NS: Final = 1_500_000_000_000_000_000


def read_run(path: Path) -> NDArray[np.float64]:
    """Rows of a file, shape (n, COLUMNS).

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


def write_bag(run: Path, folder: Path) -> Path:
    """Write the bag of one run; returns its path."""
    rows = read_run(run)
    stamps = BEGIN_NS + np.round(rows[:, TIME] * 1e9).astype(np.int64)
    torques = NEWTON_METRES * rows[:, (SPINDLE_TORQUE, JAW_TORQUE)]
    topics, path = Topics(), folder / f"{run.parent.name}_{run.stem}"
    with BagWriter(path) as bag:
        for topic, name, column in (
            (topics.motors, "spindle", SPINDLE),
            (topics.joints, "jaw", JAW),
        ):
            angle = rows[:, column] * RADIANS[column]
            bag.write_joint_states(topic, stamps, [name], angle[:, None])
        bag.write_joint_states("/reference/efforts", stamps, ["spindle", "jaw"], effort=torques)
    return path


def main(argv: Sequence[str] | None = None) -> int:
    """Convert every run of the folders; exit code 2 where one cannot be read."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="of the source")
    parser.add_argument("--out", type=Path, required=True, help="folder of the bags")
    asked = parser.parse_args(argv)
    try:
        for folder in asked.folders:
            runs = sorted(path for path in folder.glob("*.TXT") if path.stem.isdigit())
            if not runs:
                raise BagError(f"{folder} holds no run, a file such as 00.TXT")
            for run in runs:
                print(write_bag(run, asked.out))
    except (CdrjError, OSError) as error:
        print(f"convert_davinci: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
