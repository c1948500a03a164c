"""Run the demonstration: the estimator and the replay of a recording as two ROS nodes.

The exit code is that of the replay: 0 done, 1 outside the limits, 2 bad usage or input.
"""

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

POLL_S = 0.2
PATIENCE_S = 10.0


def end(process: "subprocess.Popen[bytes]") -> int:
    """End a node as Ctrl-C would, and insist only if it does not listen."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    try:
        return process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()


def main() -> int:
    """Start both nodes, wait for the replay and end the estimator."""
    # A domain of its own and no other machine: nodes that happen to run nearby stay out of it.
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    estimator = subprocess.Popen(
        [EXECUTABLES / "estimator", "--ros-args", "-p", f"robot:={ROBOT}"],
        cwd=ROOT,
        env=environment,
    )
    replay = None
    try:
        replay = subprocess.Popen(
            [EXECUTABLES / "replay", BAG, "--robot", ROBOT, "--html", REPORT],
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
