"""Progress display of long work, with the time left."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from cdrj_ros.foundation import progress
from cdrj_ros.foundation.progress import progress_bar


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
