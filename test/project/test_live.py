"""`make live` starts programs that exist, with a robot whose tensions a controller may use."""

from __future__ import annotations

import os
import runpy
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.samples import Sample
from cdrj_ros.estimation.session import LiveEstimator
from cdrj_ros.model.loading import load_model, robot_path
from cdrj_ros.model.status import UNSURE
from cdrj_ros.robot.writer import exact_copy
from cdrj_ros.simulation.follow import follow_joints

ROOT = Path(__file__).parents[2]
LIVE = runpy.run_path(str(ROOT / "tools" / "live.py"))


def test_every_program_exists_and_gets_the_robot(tmp_path: Path) -> None:
    robot = exact_copy(robot_path("finger"), tmp_path)
    started = LIVE["commands"](robot)
    assert list(started) == ["rig", "estimator", "view", "compare", "swing", "keep_taut"]
    for name, words in started.items():
        program = Path(words[1] if words[0] == sys.executable else words[0])
        assert program.name in (name, f"{name}.py")
        if program.suffix == ".py":
            assert program.exists()
        assert f"robot:={robot}" in words or name == "compare"
    without = LIVE["commands"](robot, "")
    assert "keep_taut" not in without
    assert "wished/position:=commands/position" in without["swing"]


@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_no_program_is_left_behind(by: signal.Signals) -> None:
    child = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    lines = (
        "import runpy, signal, sys",
        "signal.signal(signal.SIGINT, signal.default_int_handler)",
        f"live = runpy.run_path({str(ROOT / 'tools' / 'live.py')!r})",
        f"only = {{'one': [sys.executable, '-c', {child!r}]}}",
        "live['main'].__globals__['commands'] = lambda *_: only",
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
    model = load_model(str(exact_copy(robot_path("finger"), tmp_path)))
    time_s = np.arange(3000) * 1e-3
    pose = np.zeros((time_s.size, 2))
    pose[:, 0] = 0.5 * np.minimum(time_s, 1.0) + 0.3 * np.sin(4.0 * time_s)
    motors = follow_joints(model, pose).motor_angle
    live = LiveEstimator(model)
    for k in range(time_s.size):
        estimate = live.take(Sample(10**9 + k * 10**6, motors[k], pose[k])).estimate
    assert not np.any(estimate.status.astype(int) & UNSURE)


def test_an_exact_copy_keeps_the_robot_and_its_urdf(tmp_path: Path) -> None:
    model, copy = (
        load_model("finger3d"),
        load_model(str(exact_copy(robot_path("finger3d"), tmp_path))),
    )
    assert copy.layout == model.layout
    assert [one.name for one in copy.robot.frames] == [one.name for one in model.robot.frames]
    assert copy.robot.document["uncertainty"] == {"others": "exact"}


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


@pytest.mark.skipif("rclpy" not in sys.modules and not os.environ.get("AMENT_PREFIX_PATH"),
                    reason="ROS 2 is not installed")  # fmt: skip
def test_the_switch_of_a_controller_is_noticed_and_compared(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    import rclpy
    from cdrj_msgs.msg import CableTensions
    from compare import CompareNode  # type: ignore[import-not-found]
    from keep_taut import TautNode  # type: ignore[import-not-found]
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from std_msgs.msg import Float64MultiArray

    rclpy.init()
    executor = SingleThreadedExecutor()
    try:
        given = [Parameter("robot", value="finger")]
        controller = TautNode(parameter_overrides=given)
        compare = CompareNode(parameter_overrides=[Parameter("controller", value="keep_taut")])
        for node in (controller, compare):
            executor.add_node(node)
        sent: list[list[float]] = []
        controller.publisher.publish = lambda message: sent.append(list(message.data))
        controller.on_wish(Float64MultiArray(data=[0.1, 0.2, 0.3]))
        controller.law.share = 0.5
        for active, level in ((True, 20.0), (False, 10.0)):
            assert compare.active == active
            for k in range(1000):  # ten seconds, of which the first three are left out
                message = CableTensions(tension=[level + (k < 200), level + 2.0])
                message.header.stamp.sec, rest = divmod(1 + k, 100)
                message.header.stamp.nanosec = rest * 10_000_000
                compare.on_tensions(message)
            compare.on_timer()
            if active:
                deadline = time.monotonic() + 60.0
                compare.switch()
                while compare.active and time.monotonic() < deadline:
                    executor.spin_once(timeout_sec=0.05)
                    compare.switch()
        controller.send(1e-3, None)
        assert sent[-1] == pytest.approx([0.1, 0.2, 0.3]), "wishes are the commands"
        assert controller.law.share == 0.0
    finally:
        executor.shutdown()
        for node in (controller, compare):
            node.destroy_node()
        rclpy.try_shutdown()
    said = capsys.readouterr().out
    assert "keep_taut is off" in said
    assert (
        "off: smallest 10.0 N, mean 11.0 N, largest 12.0 N   before, "
        "on: smallest 20.0 N, mean 21.0 N, largest 22.0 N"
    ) in said
