"""Run a demonstration: estimator and replay of a recording, or with --live a simulated finger.

The replay writes report.html and report.json, and the measured errors to docs/demo.json for the
test of the README.  The exit code is that of the replay: 0 success, 1 outside the limits, 2 invalid
usage or input.

The finger is shown in the browser, with what a controller does to its cables.  It has the nodes of
demo.launch.py without ROS's launch, which is not on PyPI: rig, estimator, view, a swing of the
first joint, and the controller keep_taut, which Enter switches off and on.  The finger's numbers
count as exact, as those of a simulated robot are.  Ctrl-C, SIGTERM or a closed terminal ends all.
"""

import argparse
import json
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
ROBOT = "config/robots/prototype.yaml"
BAG = "bags/prototype_preload_36_26"
REPORT = "report.html"
FIGURES = "report.json"
MEASURED = ROOT / "docs" / "demo.json"

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PATIENCE_S = 10.0
SILENCE_S = 600.0
"""Time after which the estimator warns of silent inputs; they fall silent as the recording ends."""


def node(*program, parameters=()):
    """The command line of a node."""
    given = [part for one in parameters for part in ("-p", one)]
    return [*map(str, program), "--ros-args", *given]


def supervised(name, *parameters):
    """The command line of a node of the package that ends with this process."""
    return node(EXECUTABLES / name, "--supervised", parameters=parameters)


def recorded():
    """The command lines of the estimator and the replay of a recording."""
    replay = ("--robot", ROBOT, "--html", REPORT, "--json", FIGURES)
    return {
        "estimator": supervised("estimator", f"robot:={ROBOT}", f"timeout:={SILENCE_S}"),
        "replay": [str(EXECUTABLES / "replay"), str(BAG), *replay],
    }


def live(robot):
    """The command line of every node beside a simulated robot."""
    of_robot = f"robot:={robot}"
    taut = (of_robot, "floor:=0.0", "tighten_s:=0.05")
    return {
        "rig": supervised("rig", of_robot, "rig:=hand", "cells:=4", "truth_rate:=50.0"),
        "estimator": supervised("estimator", of_robot, "unsure_share:=0.5"),
        "view": supervised("view", of_robot),
        "compare": node(
            sys.executable, EXAMPLES / "compare.py", parameters=("controller:=keep_taut",)
        ),
        "swing": node(sys.executable, EXAMPLES / "swing.py", parameters=(of_robot,)),
        "keep_taut": node(sys.executable, EXAMPLES / "keep_taut.py", parameters=taut),
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


def run(commands, alone=False):
    """Run programs until one ends; returns its name and exit code, of a signal "" and 130.

    Args:
        commands: their command lines, by name; ``compare`` has the keyboard.
        alone: whether they hear no other node, in a ROS domain of their own on this machine.
    """
    for end_by in ENDS:
        signal.signal(end_by, signal.default_int_handler)
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", **os.environ}
    if alone:
        environment["ROS_DOMAIN_ID"] = str(1 + os.getpid() % 100)
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    processes = {}
    try:
        for name, command in commands.items():
            keys = None if name == "compare" else subprocess.DEVNULL
            processes[name] = subprocess.Popen(command, cwd=ROOT, env=environment, stdin=keys)
        while True:
            time.sleep(0.2)
            for name, process in processes.items():
                if process.poll() is not None:
                    return name, process.returncode
    except KeyboardInterrupt:
        return "", 130
    finally:
        for end_by in ENDS:  # asked again, it leaves no node behind either
            signal.signal(end_by, signal.SIG_IGN)
        end(list(processes.values()))


def keep():
    """Write the errors, which are the same in every run, without times and paths."""
    channels = json.loads((ROOT / FIGURES).read_text(encoding="utf-8"))["all"]["channels"]
    kept = {"bag": BAG, "robot": ROBOT, "channels": channels}
    MEASURED.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main(argv=None):
    """Run the demonstration and keep its errors; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--live", action="store_true", help="a simulated finger, in the browser")
    if parser.parse_args(argv).live:
        with tempfile.TemporaryDirectory() as folder:
            ended, code = run(live(exact_copy(robot_path("finger"), Path(folder))))
    else:
        ended, code = run(recorded(), alone=True)
    if ended == "replay" and code == 0:
        keep()
    elif ended and ended != "replay":
        print(f"{ended} ended, exit code {code}")
        return code or 1
    return code


if __name__ == "__main__":
    sys.exit(main())
