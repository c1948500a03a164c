"""``watch`` as a user runs it: in a pipe, in a terminal, once; and what it notes."""

import os
import pty
import re
import signal
import subprocess
import time
from io import StringIO
from time import monotonic

import pytest
from cdrj_msgs.msg import CableTensions
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rich.console import Console
from support.processes import Output

from cdrj_ros.model.packing import INVALID, STALE, UNSURE
from cdrj_ros.nodes import feed
from cdrj_ros.nodes.watch import WatchNode

PATIENCE_S = 60.0


class Source:
    """A node that publishes tensions."""

    def __init__(self, node, topic="/cdrj/tensions", reliable=True):
        kind = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self.node = node
        self.message = CableTensions(
            name=["upper/1", "lower/1"], tension=[40.0, 12.5], stddev=[1.5, 0.25], status=[0, 4]
        )
        self.publisher = node.create_publisher(
            CableTensions, topic, QoSProfile(depth=10, reliability=kind)
        )

    def publish_until(self, condition):
        """Publish at most 200 messages per second until a condition holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline
            self.message.header.stamp = self.node.get_clock().now().to_msg()
            self.publisher.publish(self.message)
            time.sleep(0.005)


@pytest.fixture
def source(node):
    return Source(node)


def test_once_prints_one_table_in_the_encoding_of_its_output_and_ends_with_code_0(
    start_executable, source, monkeypatch
):
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")  # what it lacks is escaped
    source.message.name[0] = "über/1"
    process = start_executable("watch", "--once", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    source.publish_until(lambda: process.poll() is not None)
    output, errors = (stream.decode() for stream in process.communicate())
    assert (process.returncode, errors) == (0, "")
    assert output.count("/cdrj/tensions, age ") == 1  # one message has no rate
    assert re.search(r"\\xfcber/1 .* 40\.00 .* 3\.00 .*OK", output)
    assert re.search(r"lower/1 .* 12\.50 .* 0\.50 .*UNSURE", output)
    assert "\x1b" not in output


def test_a_pipe_gets_lines_and_ctrl_c_ends_it(start_executable, source, tmp_path):
    reader, writer = os.pipe()
    errors = tmp_path / "errors"
    with errors.open("wb") as stream:
        process = start_executable("watch", stdout=writer, stderr=stream)
    os.close(writer)
    output = Output(reader)
    line = r"^/cdrj/tensions, \d+ Hz, age -?0\.\d+ s; 1 OK; 1 UNSURE$"
    source.publish_until(lambda: re.search(line, output.text, re.MULTILINE))
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 130
    assert "\x1b" not in output.finish()
    assert errors.read_text() == "watch: interrupted\n"


def test_a_terminal_gets_a_table_and_its_cursor_back(start_executable, source):
    ours, theirs = pty.openpty()
    try:
        process = start_executable("watch", stdout=theirs, stderr=theirs)
        output = Output(ours)
        source.publish_until(lambda: output.text.count("upper/1") > 3)  # drawn repeatedly
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 143
    finally:
        os.close(theirs)
    text = output.finish()
    os.close(ours)
    assert "UNSURE" in text
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")
    assert "Traceback" not in text


class Looking:
    """A watch in this process, whose clock may run ahead."""

    def __init__(self, bench, monkeypatch):
        self.bench, self.ahead_s = bench, 0.0
        monkeypatch.setattr(feed, "monotonic", lambda: monotonic() + self.ahead_s)
        self.node = bench.add(WatchNode())

    def flags(self, source, count):
        """Status of the entries, once there are so many."""

        def heard():
            source.publisher.publish(source.message)
            return len(self.node.rows()) == count

        assert self.bench.until(heard)
        return [flags for *_, flags in self.node.rows()]

    def says(self, words):
        assert self.bench.until(lambda: words in self.node.head()), self.node.head()


def test_it_says_why_no_message_arrives(bench, monkeypatch):
    watch = Looking(bench, monkeypatch)
    watch.says("no publisher of /cdrj/tensions; no other CableTensions in ROS_DOMAIN_ID ")
    Source(bench.node, "/left/cdrj/tensions")
    watch.says("; there is /left/cdrj/tensions: --ros-args -r tensions:=/left/cdrj/tensions")
    Source(bench.node)
    watch.says("nothing from /bench on /cdrj/tensions")


def test_what_cannot_be_shown_is_invalid_and_what_is_old_is_stale(bench, monkeypatch):
    watch, source = Looking(bench, monkeypatch), Source(bench.node)
    source.message.name.append("odd/1")  # without a value
    assert watch.flags(source, 1) == [INVALID]
    source.message.name.pop()
    assert watch.flags(source, 2) == [0, 4]
    watch.ahead_s = 60.0
    assert [flags for *_, flags in watch.node.rows()] == [STALE, STALE | 4]
    watch.says("nothing from /bench on /cdrj/tensions")


def test_escapes_in_names_reach_no_terminal_and_no_log(bench, monkeypatch):
    watch, source = Looking(bench, monkeypatch), Source(bench.node)
    source.message.name[0] = "\x1b]0;[red]evil[/red]\x07/1"
    source.message.status = [64, INVALID | UNSURE]  # no version knows the first flag
    watch.flags(source, 2)
    console = Console(file=StringIO(), width=100)
    console.print(watch.node.table())
    shown = console.file.getvalue()
    assert "[red]evil[/red]" in shown
    assert "FLAG 64" in shown
    assert "\x1b" not in shown
    assert "1 FLAG 64; 1 INVALID" in watch.node.line()
    assert re.search(r"lower/1 *│ *- │ *- │ INVALID", shown)
