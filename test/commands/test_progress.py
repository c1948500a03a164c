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
from cdrj_ros.foundation.output import progress_bar


def test_without_a_terminal_progress_is_an_occasional_line_with_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    clock = SimpleNamespace(now=100.0)
    monkeypatch.setattr(progress, "monotonic", lambda: clock.now)
    with progress_bar("validating", 200.0) as report:
        for now, done in ((101.0, 10.0), (106.0, 50.0), (108.0, 80.0), (120.0, 150.0)):
            clock.now = now
            report(done)
    assert capsys.readouterr().err.splitlines() == [
        "validating: 25 %, 18 s left",
        "validating: 75 %, 7 s left",
    ]


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
        with progress_bar("validating", 4.0) as report:
            for done in range(5):
                report(float(done))
        shown = shown_on(master, rb"100 %.*\d:\d\d:\d\d")
    os.close(master)
    assert "validating" in shown
