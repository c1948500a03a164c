"""``watch`` as a user runs it: in a pipe, in a terminal, once, and without messages."""

from __future__ import annotations

import os
import pty
import re
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from cdrj_msgs.msg import CableTensions
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String
from support.forked import Output

PATIENCE_S = 60.0


class Source:
    """A node that publishes tensions."""

    def __init__(self, node: Any, topic: str = "/cdrj/tensions", reliable: bool = True) -> None:
        kind = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        self.node = node
        self.message = CableTensions(
            name=["upper/1", "lower/1"], tension=[40.0, 12.5], stddev=[1.5, 0.25], status=[0, 4]
        )
        self.publisher = node.create_publisher(
            CableTensions, topic, QoSProfile(depth=10, reliability=kind)
        )

    def publish_until(self, condition: Callable[[], Any], silent: bool = False) -> None:
        """Publish at most 200 messages per second until a condition holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline
            if not silent:
                self.message.header.stamp = self.node.get_clock().now().to_msg()
                self.publisher.publish(self.message)
            time.sleep(0.005)


@pytest.fixture
def source(node: Any) -> Source:
    return Source(node)


def test_once_prints_one_table_in_the_encoding_of_its_output_and_ends_with_code_0(
    start_executable: Any, source: Source, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")  # what it lacks is escaped
    source.message.name[0] = "über/1"
    process = start_executable("watch", "--once", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    source.publish_until(lambda: process.poll() is not None)
    output, errors = (stream.decode() for stream in process.communicate())
    assert (process.returncode, errors) == (0, "")
    assert output.count("/cdrj/tensions") == 1
    assert re.search(r"\\xfcber/1 .* 40\.00 .* 3\.00 .*OK", output)
    assert re.search(r"lower/1 .* 12\.50 .* 0\.50 .*UNSURE", output)
    assert "\x1b" not in output


def test_a_pipe_gets_lines_that_report_silence_and_ctrl_c_ends_it(
    start_executable: Any, source: Source, tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    errors = tmp_path / "errors"
    with errors.open("wb") as stream:
        process = start_executable("watch", stdout=writer, stderr=stream)
    os.close(writer)
    output = Output(reader)
    line = (
        r"^/cdrj/tensions, \d+ Hz, age -?0\.\d+ s, largest upper/1 40\.00 \+-3\.00 N, "
        r"1 UNSURE 1 OK$"
    )
    source.publish_until(lambda: re.search(line, output.text, re.MULTILINE))
    # a message with a missing value is reported instead of shown
    source.message.name.append("odd/1")
    source.publish_until(lambda: "3 names, but 2 values, 2 statuses" in output.text)
    source.message.name.pop()
    seen = len(output.text)
    source.publish_until(lambda: re.search(line, output.text[seen:], re.MULTILINE))
    # the last message is soon shown as stale
    source.publish_until(lambda: "2 STALE" in output.text, silent=True)
    assert re.search(r"nothing from /test on /cdrj/tensions for \d+ s", output.text)
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 130
    assert "\x1b" not in output.finish()
    assert errors.read_text() == "watch: interrupted\n"


@pytest.mark.parametrize(
    ("number", "code", "last"),
    [(signal.SIGINT, 130, "watch: interrupted\r\n"), (signal.SIGTERM, 143, "")],
)
def test_a_terminal_gets_a_table_and_its_cursor_back(
    start_executable: Any, source: Source, number: signal.Signals, code: int, last: str
) -> None:
    ours, theirs = pty.openpty()
    try:
        process = start_executable("watch", stdout=theirs, stderr=theirs)
        output = Output(ours)
        source.publish_until(lambda: output.text.count("upper/1") > 3)  # drawn repeatedly
        process.send_signal(number)
        assert process.wait(PATIENCE_S) == code
    finally:
        os.close(theirs)
    text = output.finish()
    os.close(ours)
    assert "█" in text
    assert text.rindex("\x1b[?25h") > text.rindex("\x1b[?25l")
    assert text.endswith(last)
    assert "Traceback" not in text


def test_it_ends_when_its_output_is_closed(start_executable: Any, ros: None) -> None:
    process = start_executable("watch", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline().startswith(b"/cdrj/tensions")
    process.stdout.close()
    assert process.wait(PATIENCE_S) == 0
    with process.stderr as errors:
        assert errors.read() == b""


def test_once_without_a_publisher_ends_with_code_2_and_one_line(
    start_executable: Any, ros: None
) -> None:
    process = start_executable(
        "watch", "--once", "0.5", stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    output, errors = (stream.decode() for stream in process.communicate(timeout=PATIENCE_S))
    assert (process.returncode, output) == (2, "")
    assert re.fullmatch(
        r"watch: no publisher of /cdrj/tensions in ROS domain \d+, "
        r"ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST\n",
        errors,
    )


def test_it_reports_why_no_message_arrives(
    start_executable: Any, node: Any, tmp_path: Path
) -> None:
    elsewhere = Source(node, "/left/cdrj/tensions")
    reader, writer = os.pipe()
    with (tmp_path / "errors").open("wb") as stream:
        process = start_executable(
            "watch", "--ros-args", "-p",
            "qos_overrides./cdrj/tensions.subscription.reliability:=reliable",
            stdout=writer, stderr=stream,
        )  # fmt: skip
    os.close(writer)
    output = Output(reader)

    def says(text: str) -> None:
        elsewhere.publish_until(lambda: text in output.text, silent=True)

    says("; there is /left/cdrj/tensions: --ros-args -r tensions:=/left/cdrj/tensions\n")
    other = node.create_publisher(String, "/cdrj/tensions", 10)
    says(
        "; /cdrj/tensions is published by /test as std_msgs/msg/String, not as "
        "cdrj_msgs/msg/CableTensions\n"
    )
    node.destroy_publisher(other)
    Source(node, reliable=False)
    says(
        "; the QoS of /cdrj/tensions at /test does not fit this subscription: Best effort "
        "publisher and reliable subscription\n"
    )
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 130
