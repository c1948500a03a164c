"""The examples run and give correct results."""

import csv
import subprocess
import sys

import numpy as np
from support.places import ROOT, SAMPLE

from cdrj_ros.recordings.recording import read_recording


def without_ros(*arguments):
    """Run the example with all ROS imports blocked."""
    program = (
        "import runpy, sys\n"
        "sys.modules.update(dict.fromkeys(('rclpy', 'cdrj_msgs', 'sensor_msgs')))\n"
        "sys.argv = sys.argv[1:]\n"
        "runpy.run_path(sys.argv[0], run_name='__main__')\n"
    )
    return subprocess.run(
        [sys.executable, "-c", program, ROOT / "examples" / "without_ros.py", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_table_of_angles_becomes_a_table_of_tensions(tmp_path):
    angles, tensions = tmp_path / "angles.csv", tmp_path / "tensions.csv"
    done = without_ros(angles, tensions, "--demo")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{tensions}: 1500 estimates; refused readings: none\n"
    assert angles.read_text().startswith("t,winch,elbow\n0.0,")
    with tensions.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 1500
    last = rows[-1]
    recording = read_recording(SAMPLE)
    begin_ns = max(
        int(s.stamp_ns[0]) for s in (*recording.motors.values(), *recording.joints.values())
    )
    t_ns = begin_ns + round(float(last["t"]) * 1e9)
    names = [name for name in recording.references if name.startswith("tension/")]
    assert len(names) == 16
    for name in names:
        truth = recording.references[name]
        expected = np.interp(t_ns - begin_ns, truth.stamp_ns - begin_ns, truth.value)
        element = name.removeprefix("tension/")
        error = float(last[element]) - expected
        assert abs(error) < 3.0 * float(last[f"{element} sigma"]), element
        if element != "lower/8":  # the last that 3 s of motion make certain
            assert last[f"{element} status"] == "0", element
    assert float(rows[0]["upper/8 sigma"]) > float(last["upper/8 sigma"]) > 0.0


def test_a_table_without_the_robots_columns_is_refused_in_one_line(tmp_path):
    angles = tmp_path / "angles.csv"
    angles.write_text("t,winch\n0,0\n")
    done = without_ros(angles, tmp_path / "tensions.csv")
    assert done.returncode == 2
    assert "has no column elbow" in done.stderr
    assert "Traceback" not in done.stderr
