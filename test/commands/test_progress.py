"""Progress display of long work, with the time left."""

from __future__ import annotations

import os
import pty
import re
import select
import sys
import time
from types import SimpleNamespace

import pytest

from cdrj_ros.foundation import output as progress
from cdrj_ros.foundation.output import ProgressBar


def test_without_a_terminal_progress_is_an_occasional_line_with_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress, "monotonic", lambda: clock.now)
    with ProgressBar("validating", 200.0) as report:
        for now, done in ((101.0, 10.0), (106.0, 50.0), (108.0, 80.0), (120.0, 150.0)):
            clock.now = now
            report(done)
    assert capsys.readouterr().err.splitlines() == [
        "validating: 25 %, 18 s left",
        "validating: 75 %, 7 s left",
    ]
    bar = ProgressBar("fitting")
    clock.now += 6.0
    bar(0.0, "step 3")
    bar(0.0, "step 4")
    bar.begin("playing", 10.0)
    clock.now += 6.0
    bar(5.0, "half")
    bar.say("a line")
    assert capsys.readouterr().err.splitlines() == [
        "fitting: step 3", "playing: 50 %, 6 s left, half", "a line",
    ]  # fmt: skip


def shown_on(master: int, pattern: bytes, patience_s: float = 60.0) -> str:
    """Output of a terminal, read until the pattern appears, since one read may be incomplete."""
    shown = b""
    deadline = time.monotonic() + patience_s
    while not re.search(pattern, shown):
        ready, _, _ = select.select([master], [], [], max(deadline - time.monotonic(), 0.0))
        assert ready, f"no {pattern!r} in {shown!r}"
        shown += os.read(master, 65536)
    return shown.decode(errors="replace")  # the last character may be incomplete


def test_in_a_terminal_progress_is_a_bar_with_the_time_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    master, slave = pty.openpty()
    monkeypatch.setenv("TERM", "xterm")
    with os.fdopen(slave, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        with ProgressBar("validating", 4.0) as report:
            for done in range(5):
                report(float(done), "a text")
            report.say("[a] line")
        shown = shown_on(master, rb"100 %.*\d:\d\d:\d\d.*a text")
    os.close(master)
    assert "validating" in shown
    assert "[a] line" in shown
