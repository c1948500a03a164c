"""Show a simulated finger in the browser while a controller keeps its cables from slack.

    python tools/live.py [--seconds S]

It starts the nodes of demo.launch.py without ROS's launch, which is not on PyPI: rig, estimator,
view, the controller keep_taut and a swing of the first joint. The finger's numbers count as exact,
as if they had been identified. Ctrl-C, SIGTERM or a closed terminal ends all of them.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ruamel.yaml import YAML

ROOT = Path(__file__).resolve().parent.parent
EXECUTABLES = ROOT / "install" / "cdrj_ros" / "lib" / "cdrj_ros"
EXAMPLES = ROOT / "examples"
FINGER = ROOT / "config" / "robots" / "finger.yaml"
RIG = ("payload:=0.02", "damping:=0.02", "cells:=4", "truth_rate:=50.0")
PATIENCE_S = 10.0


def exact_finger(folder):
    """Write the finger's file with exact numbers; returns its path."""
    yaml = YAML()
    document = yaml.load(FINGER.read_text(encoding="utf-8"))
    document["uncertainty"] = {"others": "exact"}
    path = Path(folder) / "finger.yaml"
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(document, file)
    return path


def commands(robot):
    """The command line of every node."""

    def node(*program, parameters=()):
        given = [part for one in (f"robot:={robot}", *parameters) for part in ("-p", one)]
        return [*map(str, program), "--ros-args", *given]

    return {
        "rig": node(EXECUTABLES / "rig", "--supervised", parameters=RIG),
        "estimator": node(EXECUTABLES / "estimator", "--supervised"),
        "view": node(EXECUTABLES / "view", "--supervised"),
        "keep_taut": node(sys.executable, EXAMPLES / "keep_taut.py"),
        "swing": node(sys.executable, EXAMPLES / "swing.py"),
    }


def end(processes):
    """Interrupt all processes, and kill those that do not end in time."""
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for process in processes:
        try:
            process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def main():
    """Run until Ctrl-C, or until a node ends; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=float("inf"), help="then end")
    until = time.monotonic() + parser.parse_args().seconds
    for end_by in (signal.SIGTERM, signal.SIGHUP):  # no node is left behind
        signal.signal(end_by, signal.default_int_handler)
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    processes = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            for name, command in commands(exact_finger(folder)).items():
                processes[name] = subprocess.Popen(command, cwd=ROOT, env=environment)
            while time.monotonic() < until:
                time.sleep(0.2)
                for name, process in processes.items():
                    if process.poll() is not None:
                        print(f"{name} ended, exit code {process.returncode}")
                        return process.returncode or 1
        except KeyboardInterrupt:
            return 130
        finally:
            end(list(processes.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
