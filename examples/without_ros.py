"""Estimate tensions from a table of angles, without ROS.

The table is a CSV file: a column `t` [s] and a column for every motor and joint of the robot, by
name [rad]. The output is a CSV file with `t`, and for every cable element its tension [N], standard
deviation [N] and status (flags of cdrj_msgs/CableTensions; 0: no flag is set).

    python3 without_ros.py angles.csv tensions.csv --robot prototype
    python3 without_ros.py angles.csv tensions.csv --demo    # makes angles.csv first
"""

import argparse
import csv
from pathlib import Path

import numpy as np

import cdrj_ros as cdrj

SAMPLE_BAG = Path(__file__).resolve().parents[1] / "bags" / "prototype_preload_36_26"
FIRST_NS = 1_000_000_000  # a stamp of 0 denotes a missing stamp


def write_demo(path, seconds=3.0, rate_hz=500.0):
    """Write the first seconds of the sample recording as a table."""
    recording = cdrj.read_recording(SAMPLE_BAG)
    channels = {**recording.motors, **recording.joints}
    begin_ns = max(int(series.stamp_ns[0]) for series in channels.values())
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    columns = [
        np.interp(t, (series.stamp_ns - begin_ns) * 1e-9, series.value)
        for series in channels.values()
    ]
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["t", *channels])
        rows.writerows(np.column_stack([t, *columns]).tolist())


def estimate(angles, tensions, robot):
    """Read the table of angles, estimate row by row and write the table of tensions.

    Returns the number of estimates and the numbers of refused readings by cause.
    """
    estimator = cdrj.Estimator(robot)
    layout = estimator.model.layout
    with angles.open(newline="") as source, tensions.open("w", newline="") as target:
        rows = csv.DictReader(source)
        missing = {"t", *layout.motors, *layout.joints} - set(rows.fieldnames or ())
        if missing:
            raise cdrj.UsageError(f"{angles} has no column {', '.join(sorted(missing))}")
        out = csv.writer(target)
        kinds = ("", " sigma", " status")
        out.writerow(["t", *(name + kind for name in layout.elements for kind in kinds)])
        count, first_s = 0, None
        for row in rows:
            first_s = float(row["t"]) if first_s is None else first_s
            estimator.update(
                FIRST_NS + round((float(row["t"]) - first_s) * 1e9),
                motors={name: float(row[name]) for name in layout.motors},
                joints={name: float(row[name]) for name in layout.joints},
            )
            # A reading may be refused, or held until a later one arrives.
            for one in estimator.estimates:
                t = first_s + (one.stamp_ns - FIRST_NS) * 1e-9
                values = np.column_stack([one.tension, one.tension_stddev, one.status])
                out.writerow([f"{t:.9g}", *(f"{value:.6g}" for value in values.ravel())])
                count += 1
    return count, estimator.refused


def main():
    """Parse the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("angles", type=Path)
    parser.add_argument("tensions", type=Path)
    parser.add_argument("--robot", default="prototype", help="file or name (default %(default)s)")
    parser.add_argument("--demo", action="store_true", help="write a table of angles first")
    arguments = parser.parse_args()
    try:
        if arguments.demo:
            write_demo(arguments.angles)
        count, refused = estimate(arguments.angles, arguments.tensions, arguments.robot)
    except (cdrj.CdrjError, OSError, ValueError) as error:
        parser.error(str(error))
    print(f"{arguments.tensions}: {count} estimates; refused readings: {refused or 'none'}")


if __name__ == "__main__":
    main()
