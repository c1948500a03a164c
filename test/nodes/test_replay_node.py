"""The replay command as a user runs it, with one estimator process for all tests."""

import json
import os
import re
import signal
import subprocess
import time

import numpy as np
import pytest
import rclpy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from support.places import ROBOT
from support.processes import Output, end
from support.restamped import SECOND, restamped

from cdrj_ros.nodes.replay import main
from cdrj_ros.recordings.recording import read_recording

PATIENCE_S = 120.0
LAST_WORDS_S = 30.0

ANSWERED = r"[1-9]\d* answered"
"""Pattern of a progress line once estimates have been received."""


@pytest.fixture(scope="module")
def estimator(executables, tmp_path_factory):
    """One estimator for many replays; each replay resets it."""
    log = tmp_path_factory.mktemp("estimator") / "log"
    with log.open("wb") as stream:
        process = subprocess.Popen(
            [executables / "estimator", "--ros-args", "-p", f"robot:={ROBOT}"],
            stdout=stream,
            stderr=stream,
        )
    deadline = time.monotonic() + PATIENCE_S
    while " pulleys" not in log.read_text(errors="replace"):
        assert process.poll() is None, log.read_text(errors="replace")
        assert time.monotonic() < deadline, log.read_text(errors="replace")
        time.sleep(0.05)
    yield process
    end(process)


class Replay:
    """A replay process whose output is read while it runs."""

    def __init__(self, process, stream):
        self.process, self._printed = process, Output(stream)

    @property
    def output(self):
        return self._printed.text

    def wait_for(self, pattern, patience_s=PATIENCE_S):
        """Wait for a pattern; the last output of an ended process may arrive with a delay."""
        deadline = time.monotonic() + patience_s
        while not re.search(pattern, self.output):
            if self.process.poll() is not None:
                deadline = min(deadline, time.monotonic() + LAST_WORDS_S)
            assert time.monotonic() < deadline, f"no {pattern!r} in:\n{self.output}"
            time.sleep(0.01)

    def finish(self):
        return self.process.wait(2 * PATIENCE_S), self._printed.finish()


def _spun_until(node, condition):
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > deadline:
            return False
        rclpy.spin_once(node, timeout_sec=0.1)
    return True


@pytest.fixture
def replay(start_executable):
    """Start a replay of a bag with the robot and further arguments."""

    def start(bag, *arguments):
        reader, writer = os.pipe()
        words = ("replay", bag, "--robot", ROBOT, *arguments)
        process = start_executable(*words, stdout=writer, stderr=writer)
        os.close(writer)
        return Replay(process, reader)

    return start


def _facts(path):
    (bag,) = json.loads(path.read_text())["bags"]
    return dict(bag["facts"])


@pytest.mark.usefixtures("few_pictures")
def test_replay_evaluates_the_node_and_writes_json_and_report(
    estimator, short_bag, tmp_path, capfd
):
    figures, report = tmp_path / "f.json", tmp_path / "r.html"
    twice = ("--loop", "2", "--playback-duration", "1")
    files = ("--json", str(figures), "--html", str(report))
    assert main([short_bag, "--robot", ROBOT, *twice, *files]) == 0
    assert "all elements" in capfd.readouterr().out
    (bag,) = json.loads(figures.read_text())["bags"]
    assert bag["channels"]["tension/upper/8"]["mean_relative_error"] < 0.015
    facts = bag["facts"]
    assert facts["estimates lost"] == "0"
    assert facts["estimates received"] == facts["estimates expected"] != "0"
    assert "inputs/s" in facts["rate achieved"]
    assert facts["latency"].startswith("p50 ")
    assert "2 passes, 2 of them whole" in facts["played"]
    assert facts["between passes"].startswith("0 at most")
    assert "tension/upper/8" in report.read_text()
    assert "rate achieved" in report.read_text()
    assert "Status OK" not in report.read_text(), "answers are read without their status"


def test_the_clock_follows_the_recording(estimator, replay, short_bag, node):
    clocks = []
    node.create_subscription(
        Clock, "/clock", lambda m: clocks.append(m.clock.sec + m.clock.nanosec * 1e-9), 1000
    )
    one = replay(short_bag, "--clock", "50", "--rate", "0.5", "--playback-duration", "2")
    assert _spun_until(node, lambda: one.process.poll() is not None), one.output
    code, out = one.finish()
    assert code == 0, out
    begin = read_recording(short_bag).start_ns * 1e-9
    assert clocks == sorted(clocks)
    assert np.median(np.diff(clocks)) == pytest.approx(0.01, abs=0.003)
    assert begin - 0.1 < clocks[0]
    assert begin + 1.9 < clocks[-1] < begin + 2.1
    assert "ms behind the recorded time" in out


def test_ctrl_c_writes_the_report_of_what_was_played_and_exits_with_130(
    estimator, replay, longer_bag, tmp_path
):
    figures = tmp_path / "f.json"
    one = replay(longer_bag, "--rate", "1", "--json", str(figures))
    one.wait_for(ANSWERED)
    one.process.send_signal(signal.SIGINT)
    code, out = one.finish()
    assert code == 130, out
    assert out.endswith("replay: interrupted\n")
    assert out.count("interrupted") == 1
    assert "Traceback" not in out
    facts = _facts(figures)
    assert "ended by the user at" in facts["played"]
    assert facts["estimates lost"] == "0"
    assert int(facts["estimates received"]) > 0


def test_an_estimator_that_disappears_is_reported_and_its_answers_are_evaluated(
    start_executable, replay, longer_bag, tmp_path
):
    there = ("-r", "__ns:=/mortal")
    mortal = start_executable("estimator", "--ros-args", "-p", f"robot:={ROBOT}", *there)
    one = replay(longer_bag, "--rate", "1", "--ros-args", *there)
    one.wait_for(ANSWERED, 2 * PATIENCE_S)
    mortal.send_signal(signal.SIGINT)
    code, out = one.finish()
    assert code == 1, out
    assert "the estimator disappeared" in out
    assert "all elements" in out
    assert "Traceback" not in out


@pytest.mark.usefixtures("estimator")
def test_a_replay_that_compares_nothing_says_why_and_exits_with_1(short_bag, tmp_path, capfd):
    arguments = ("--robot", ROBOT, "--playback-duration", "1")
    three_hours = 3 * 3600 * SECOND
    apart = restamped(short_bag, tmp_path / "apart", {"/cdrj/joint_states": three_hours})
    assert main([apart, *arguments]) == 1
    error = capfd.readouterr().err
    assert "nothing was compared" in error
    assert "the stamps of elbow are 10800.0 s ahead of those of winch" in error
    assert main([short_bag, *arguments, "--reference", "/nowhere"]) == 1
    assert "the bag has no references" in capfd.readouterr().err


def test_without_an_estimator_the_missing_parts_are_named(short_bag, monkeypatch, capfd):
    from cdrj_ros.nodes import player

    monkeypatch.setattr(player, "PATIENCE_S", 1.0)
    there = ("--ros-args", "-r", "__ns:=/nobody")
    assert main([short_bag, "--robot", ROBOT, *there]) == 2
    out = capfd.readouterr().err
    assert "no estimator within 1 s" in out
    assert "no service /nobody/estimator/reset" in out
    assert "Traceback" not in out


@pytest.mark.usefixtures("estimator")
def test_an_estimator_that_listens_elsewhere_is_said_to_be_remapped(short_bag, replay):
    """As one beside ros2_control is, if the replay is not: here the other way round."""
    playing = replay(short_bag, "--ros-args", "-r", "motor_states:=/joint_states")
    playing.wait_for("no subscriber of /joint_states; inputs remapped for the estimator")
    playing.process.send_signal(signal.SIGINT)
    playing.finish()


@pytest.mark.usefixtures("estimator", "ros")
def test_a_recording_is_not_played_into_the_readings_of_a_robot(short_bag, replay):
    """Both would be one motion for the estimator, which the replay resets, too."""
    robot = rclpy.create_node("driver")
    publisher = robot.create_publisher(JointState, "/cdrj/joint_states", 10)
    try:
        assert _spun_until(robot, lambda: publisher.get_subscription_count() > 0)
        code, out = replay(short_bag, "--rate", "1").finish()
    finally:
        robot.destroy_node()
    assert code == 2
    assert re.search("/cdrj/joint_states is published by others, too(: /driver)?; stop them", out)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--rate", "nan"), "--rate"),
        (("--loop", "-1"), "--loop"),
        (("--start-offset", "1e6"), "--start-offset"),
        (("--html", "no/such/report.html"), "there is no folder no/such"),
    ],
)
def test_invalid_options_of_replay_are_refused_in_one_line(arguments, words, short_bag, capsys):
    assert main([short_bag, "--robot", ROBOT, *arguments]) == 2
    errors = capsys.readouterr().err
    assert words in errors
    assert errors.count("\n") == 1
