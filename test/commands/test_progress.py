"""Progress display of long work, with the time left."""

from types import SimpleNamespace

from cdrj_ros.foundation import output as progress
from cdrj_ros.foundation.output import ProgressBar


def test_without_a_terminal_progress_is_an_occasional_line_with_the_time_left(monkeypatch, capsys):
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
