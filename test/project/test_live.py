"""`make live` starts programs that exist, with a robot whose tensions a controller may use."""

import os
import runpy
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.places import ROOT

from cdrj_ros.model.prepared import robot_path
from cdrj_ros.robot.writer import exact_copy

DEMO = runpy.run_path(str(ROOT / "tools" / "demo.py"))


def test_every_program_exists_and_gets_the_robot(tmp_path):
    robot = exact_copy(robot_path("finger"), tmp_path)
    started = DEMO["live"](robot)
    assert list(started) == ["rig", "estimator", "view", "compare", "swing", "keep_taut"]
    for name, words in started.items():
        program = Path(words[1] if words[0] == sys.executable else words[0])
        assert program.name in (name, f"{name}.py")
        if program.suffix == ".py":
            assert program.exists()
        assert f"robot:={robot}" in words or name == "compare"


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGHUP])
def test_no_program_is_left_behind(by):
    child = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    lines = (
        "import runpy, signal, sys",
        "signal.signal(signal.SIGINT, signal.default_int_handler)",
        f"demo = runpy.run_path({str(ROOT / 'tools' / 'demo.py')!r})",
        f"only = {{'one': [sys.executable, '-c', {child!r}]}}",
        "sys.exit(demo['run'](only)[1])",
    )
    with subprocess.Popen([sys.executable, "-c", "\n".join(lines)], stdout=subprocess.PIPE) as live:
        pid = int(live.stdout.readline())
        live.send_signal(by)
        assert live.wait(30.0) == 130
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
