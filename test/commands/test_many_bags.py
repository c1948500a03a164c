"""Many bags: no bag lost to another, and no process left behind."""

import json
import os
import shutil
import signal
import subprocess
import sys
from threading import Event

import psutil
from support.places import ROBOT, SAMPLE

from cdrj_ros.commands import validate
from cdrj_ros.recordings.writer import BagWriter

PROGRAM = "from cdrj_ros.commands.entry import validate; validate()"


def command(*arguments):
    return [sys.executable, "-c", PROGRAM, *map(str, arguments), "--robot", ROBOT]


def figures(path):
    found = json.loads(path.read_text())
    for bag in found["bags"]:
        del bag["facts"]["time"]
    return found


def test_a_bag_that_breaks_off_or_is_none_is_named_and_the_others_are_compared(tmp_path, capsys):
    shutil.copytree(SAMPLE, tmp_path / "good")
    (tmp_path / "none.mcap").write_bytes(b"nothing")
    (tmp_path / "other").mkdir()
    with BagWriter(tmp_path / "other" / "bag") as bag:  # another robot's
        bag.write_joint_states("/cdrj/motor_states", [1, 2], ("m",), position=[[0.0], [0.0]])
        bag.write_joint_states("/cdrj/joint_states", [1, 2], ("j",), position=[[0.0], [0.0]])
        bag.write_tensions("/reference/tensions", [1, 2], ("upper/1",), [[1.0], [1.0]])
    bags = [tmp_path / "none.mcap", tmp_path / "good", tmp_path / "other" / "bag"]
    out = tmp_path / "figures.json"
    code = validate.main([*map(str, bags), "--robot", ROBOT, "--json", str(out)])
    assert code == 2
    captured = capsys.readouterr()
    errors = [line for line in captured.err.splitlines() if "%" not in line]
    assert "none.mcap is not an MCAP file" in errors[0]
    assert "no motor named winch" in errors[1]
    assert errors[2] == "validate: 2 of 3 bags failed; the results are of the other 1"
    assert len(errors) == 3
    assert [bag["path"] for bag in figures(out)["bags"]] == [str(bags[1])]
    assert "all elements" in captured.out


def test_ctrl_c_leaves_no_process_behind():
    with subprocess.Popen(
        command(*[SAMPLE] * 60, "--jobs", 2),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        family = psutil.Process(process.pid)
        pause = Event()
        # joblib's resource tracker and both workers
        while sum(child.cpu_times().user > 1.0 for child in children(family)) < 2:
            assert process.poll() is None
            pause.wait(0.05)
        everyone = children(family)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        error = process.stderr.read()
        assert process.wait(60.0) == 130
    _, alive = psutil.wait_procs(everyone, timeout=30.0)
    assert not alive
    assert "Traceback" not in error
    # Python may add a warning of what the ended processes have left
    assert error.splitlines().count("validate: interrupted") == 1


def children(family):
    found = []
    for child in family.children(recursive=True):
        try:
            child.cpu_times()
        except psutil.NoSuchProcess:
            continue
        found.append(child)
    return found
