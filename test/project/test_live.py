"""`make live` starts programs that exist, with a robot whose tensions a controller may use."""

from __future__ import annotations

import os
import runpy
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.samples import Sample
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.loading import load_model
from cdrj_ros.model.status import UNSURE
from cdrj_ros.simulation.follow import follow_joints

ROOT = Path(__file__).parents[2]
LIVE = runpy.run_path(str(ROOT / "tools" / "live.py"))


def test_every_program_exists_and_gets_the_robot(tmp_path: Path) -> None:
    robot = LIVE["exact_finger"](tmp_path)
    started = LIVE["commands"](robot)
    assert list(started) == ["rig", "estimator", "view", "keep_taut", "swing"]
    for words in started.values():
        program = Path(words[1] if words[0] == sys.executable else words[0])
        assert program.name in ("rig", "estimator", "view", "keep_taut.py", "swing.py")
        if program.suffix == ".py":
            assert program.exists()
        assert f"robot:={robot}" in words


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_no_program_is_left_behind(by: signal.Signals) -> None:
    child = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    lines = (
        "import runpy, signal, sys",
        "signal.signal(signal.SIGINT, signal.default_int_handler)",
        f"live = runpy.run_path({str(ROOT / 'tools' / 'live.py')!r})",
        f"only = {{'one': [sys.executable, '-c', {child!r}]}}",
        "live['main'].__globals__['commands'] = lambda robot: only",
        "sys.argv = ['live.py']",
        "sys.exit(live['main']())",
    )
    with subprocess.Popen([sys.executable, "-c", "\n".join(lines)], stdout=subprocess.PIPE) as live:
        assert live.stdout is not None
        pid = int(live.stdout.readline())
        live.send_signal(by)
        assert live.wait(30.0) == 130
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_the_fingers_tensions_become_sure_with_exact_numbers(tmp_path: Path) -> None:
    model = load_model(str(LIVE["exact_finger"](tmp_path)))
    time_s = np.arange(3000) * 1e-3
    pose = np.zeros((time_s.size, 2))
    pose[:, 0] = 0.5 * np.minimum(time_s, 1.0) + 0.3 * np.sin(4.0 * time_s)
    motors = follow_joints(model, pose).motor_angle
    live = LiveEstimator(model)
    for k in range(time_s.size):
        estimate = live.take(Sample(10**9 + k * 10**6, motors[k], pose[k])).estimate
    assert not np.any(estimate.status.astype(int) & UNSURE)


@pytest.mark.skipif("rclpy" not in sys.modules and not os.environ.get("AMENT_PREFIX_PATH"),
                    reason="ROS 2 is not installed")  # fmt: skip
def test_the_swing_returns_to_where_it_repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    import rclpy
    from swing import SwingNode  # type: ignore[import-not-found]

    rclpy.init()
    try:
        node = SwingNode()
        jump = np.abs(node.angles[-1] - node.angles[node.start])
        step = np.abs(np.diff(node.angles, axis=0)).max(axis=0)
        assert np.all(jump <= 1.1 * step)
        for _ in range(len(node.angles) + 5):
            node.on_timer()
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
