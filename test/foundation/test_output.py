"""A failure of standard output has no other effect, and no name can control the terminal."""

import io
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.commands.entry import run_command
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.foundation.output import printable, say


def full():
    return Path("/dev/full").open("w", encoding="utf-8")


def without_reader():
    reading, writing = os.pipe()
    os.close(reading)
    return os.fdopen(writing, "w", encoding="utf-8")


def closed():
    stream = io.TextIOWrapper(io.BytesIO())
    stream.close()
    return stream


@pytest.mark.parametrize("make", [full, without_reader, closed, lambda: None])
def test_a_failure_of_standard_output_does_not_change_the_exit_code(make, monkeypatch, capsys):
    done = []

    def body(_):
        for k in range(10_000):
            say(f"line {k}")
            sys.stdout.flush()
        done.append(True)
        return 1

    stream = make()
    monkeypatch.setattr(sys, "stdout", stream)
    before = sys.stdout, sys.stderr
    assert run_command("validate", body, []) == 1
    assert done == [True]
    assert (sys.stdout, sys.stderr) == before
    if stream is not None and not stream.closed:
        stream.close()  # otherwise the flush at the interpreter's exit would fail
    told = ["validate: standard output: No space left on device; the rest is not shown"]
    assert capsys.readouterr().err.splitlines() == (told if make is full else [])


def test_characters_that_an_encoding_lacks_are_escaped(monkeypatch):
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)

    def body(_):
        say("R² ±2σ \udcff")
        return 0

    assert run_command("validate", body, []) == 0
    assert raw.getvalue() == b"R\\xb2 \\xb12\\u03c3 \\udcff\n"


def test_control_characters_in_output_are_escaped(capsys):
    say("bag \x1b[2J\r\x9b31m of\nyesterday, câble – 索")
    assert capsys.readouterr().out == "bag \\x1b[2J\\r\\x9b31m of\nyesterday, câble – 索\n"
    assert printable("a\x1b[31mb\n\udc80\u202e") == "a\\x1b[31mb\\n\\udc80\\u202e"


NASTY = "\x1b[31mbag\nof two lines"


@pytest.mark.parametrize("error", [BagError(NASTY), OSError(2, "gone", NASTY)])
def test_an_error_is_one_line_for_any_names_in_it(error, capsys):
    def body(_):
        raise error

    assert run_command("validate", body, []) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("validate: \\x1b[31mbag\\nof two lines")


def test_a_lack_of_memory_is_one_line(capsys):
    def body(_):
        return int(np.empty((10**15, 906)).size)

    assert run_command("simulate", body, []) == 2
    said = capsys.readouterr().err
    assert said.startswith("simulate: not enough memory: Unable to allocate")
    assert said.count("\n") == 1
