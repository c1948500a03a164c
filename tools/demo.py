"""Run the demonstration: the estimator and the replay of a recording as two ROS nodes.

It writes report.html and report.json, and the measured errors to docs/demo.json for the test of
the README.
The exit code is that of the replay: 0 success, 1 outside the limits, 2 invalid usage or input.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EXECUTABLES = ROOT / "install" / "cdrj_ros" / "lib" / "cdrj_ros"
ROBOT = "config/robots/prototype.yaml"
BAG = "bags/prototype_preload_36_26"
REPORT = "report.html"
FIGURES = "report.json"
MEASURED = ROOT / "docs" / "demo.json"

POLL_S = 0.2
PATIENCE_S = 10.0

# The estimator warns of silent inputs after this time; they fall silent when the recording ends.
SILENCE_S = 600.0


def end(process: "subprocess.Popen[bytes]") -> int:
    """Send SIGINT to a node, and kill it if it does not end in time."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def keep() -> None:
    """Write the errors, which are the same in every run, without times and paths."""
    channels = json.loads((ROOT / FIGURES).read_text(encoding="utf-8"))["all"]["channels"]
    kept = {"bag": BAG, "robot": ROBOT, "channels": channels}
    MEASURED.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> int:
    """Run the demonstration and keep its errors; returns the replay's exit code."""
    for end_by in (signal.SIGTERM, signal.SIGHUP):  # no node is left behind
        signal.signal(end_by, signal.default_int_handler)
    code = play()
    if code == 0:
        keep()
    return code


def play() -> int:
    """Start both nodes, wait for the replay and end the estimator."""
    # Use a separate domain on the local host, isolated from other running nodes.
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    given = ["-p", f"robot:={ROBOT}", "-p", f"timeout:={SILENCE_S}"]
    estimator = subprocess.Popen(
        [EXECUTABLES / "estimator", "--supervised", "--ros-args", *given],
        cwd=ROOT,
        env=environment,
    )
    replay = None
    try:
        replay = subprocess.Popen(
            [EXECUTABLES / "replay", BAG, "--robot", ROBOT, "--html", REPORT, "--json", FIGURES],
            cwd=ROOT,
            env=environment,
        )
        while True:
            try:
                return replay.wait(POLL_S)
            except subprocess.TimeoutExpired:
                if estimator.poll() is not None:
                    print(f"the estimator ended early, exit code {estimator.returncode}")
                    return estimator.returncode or 1
    except KeyboardInterrupt:
        return 130
    finally:
        for process in (replay, estimator):
            if process is not None:
                end(process)


if __name__ == "__main__":
    sys.exit(main())
