"""Show a simulated finger in the browser, and what a controller does to its cables.

    python tools/live.py [--controller NAME] [--seconds S]

It starts the nodes of demo.launch.py without ROS's launch, which is not on PyPI: rig, estimator,
view, a swing of the first joint, and the controller keep_taut, which Enter switches off and on.
The terminal says what runs, and the tensions with and without the controller. The finger's numbers
count as exact, as those of a simulated robot are. Ctrl-C, SIGTERM or a closed terminal ends all.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from cdrj_ros.model.prepared import robot_path
from cdrj_ros.robot.writer import exact_copy

ROOT = Path(__file__).resolve().parent.parent
EXECUTABLES = ROOT / "install" / "cdrj_ros" / "lib" / "cdrj_ros"
EXAMPLES = ROOT / "examples"
RIG = ("rig:=hand", "cells:=4", "truth_rate:=50.0")
PATIENCE_S = 10.0


def commands(robot, controller="keep_taut"):
    """The command line of every node."""

    def node(*program, parameters=()):
        given = [part for one in parameters for part in ("-p", one)]
        return [*map(str, program), "--ros-args", *given]

    of_robot = (f"robot:={robot}",)
    started = {
        "rig": node(EXECUTABLES / "rig", "--supervised", parameters=(*of_robot, *RIG)),
        "estimator": node(
            EXECUTABLES / "estimator", "--supervised", parameters=(*of_robot, "unsure_share:=0.5")
        ),
        "view": node(EXECUTABLES / "view", "--supervised", parameters=of_robot),
        "compare": node(
            sys.executable,
            EXAMPLES / "compare.py",
            parameters=(f"controller:={controller}",) if controller else (),
        ),
        "swing": node(sys.executable, EXAMPLES / "swing.py", parameters=of_robot),
    }
    if controller:
        script = EXAMPLES / f"{controller}.py"
        gentle = ("floor:=0.0", "tighten_s:=0.05")
        started[controller] = node(sys.executable, script, parameters=(*of_robot, *gentle))
    else:
        started["swing"] += ["-r", "wished/position:=commands/position"]
    return started


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
    parser.add_argument(
        "--controller", default="keep_taut", choices=("keep_taut", ""), help="empty: none"
    )
    given = parser.parse_args()
    until = time.monotonic() + given.seconds
    for end_by in (signal.SIGTERM, signal.SIGHUP):  # no node is left behind
        signal.signal(end_by, signal.default_int_handler)
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    processes = {}
    with tempfile.TemporaryDirectory() as folder:
        try:
            robot = exact_copy(robot_path("finger"), Path(folder))
            for name, command in commands(robot, given.controller).items():
                keys = None if name == "compare" else subprocess.DEVNULL
                processes[name] = subprocess.Popen(command, cwd=ROOT, env=environment, stdin=keys)
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
