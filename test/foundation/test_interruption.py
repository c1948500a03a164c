"""The end of an interrupted command whose main thread does not end it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from cdrj_ros.foundation.interruption import BLAS_THREADS

PATIENCE_S = 30.0
WAITING = """
import os, signal, time
from cdrj_ros.foundation.interruption import deferring, restoring, run_interruptibly

def main():
    signal.signal(signal.SIGINT, lambda *_: None)  # only notes the request, as a node does
    with {block}:
        os.write(1, b"ready")
        while True:  # a callback that never returns
            time.sleep(60.0)

run_interruptibly("waiting", lambda: main)
"""


@pytest.mark.parametrize(
    ("block", "errors"),
    [
        ("deferring()", "waiting: interrupted\n"),
        (
            "deferring(), restoring(lambda: os.write(2, b'restored, '))",
            "restored, waiting: interrupted\n",
        ),
    ],
)
def test_a_command_that_does_not_end_by_itself_is_ended(block: str, errors: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", WAITING.format(block=block)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.read(5) == "ready"
            process.send_signal(signal.SIGINT)
            assert process.communicate(timeout=PATIENCE_S)[1] == errors
            assert process.returncode == 130
        finally:
            process.kill()


def test_an_interrupt_before_the_handler_is_installed_is_one_line() -> None:
    script = """
import os, signal
signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # as the installed executables start
os.kill(os.getpid(), signal.SIGINT)
from cdrj_ros.foundation.interruption import run_interruptibly
run_interruptibly("blocked", lambda: print)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "blocked: interrupted\n")


@pytest.mark.parametrize(
    "failure", ["RobotFileError('no object')", "OSError('no object')", "KeyError(1)"]
)
def test_an_error_after_a_swallowed_interrupt_counts_as_the_interrupt(failure: str) -> None:
    """A library may catch KeyboardInterrupt; the use of what it did not make fails later."""
    script = f"""
import os, signal
from cdrj_ros.commands.running import run_command
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.interruption import run_interruptibly

def body(_):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        sum(range(1000))
    except BaseException:
        pass
    raise {failure}

run_interruptibly("swallowing", lambda: lambda: run_command("swallowing", body, []))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "swallowing: interrupted\n")


def test_without_an_interrupt_an_error_stays_an_error() -> None:
    script = """
from cdrj_ros.commands.running import run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.interruption import run_interruptibly

def body(_):
    raise UsageError("")

run_interruptibly("failing", lambda: lambda: run_command("failing", body, []))
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (2, "failing: \n")


@pytest.mark.parametrize(("last", "code"), [("pass", 0), ("raise KeyboardInterrupt", 130)])
def test_an_interrupt_after_the_end_of_a_command_changes_nothing(last: str, code: int) -> None:
    script = f"""
import os, signal, sys
from cdrj_ros.foundation import interruption

ignore = signal.signal

def late(number, handler):
    if handler is signal.SIG_IGN:
        os.kill(os.getpid(), signal.SIGINT)
    return ignore(number, handler)

def main():
    signal.signal = late
    {last}
    return 0

interruption.run_interruptibly("late", lambda: main)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=PATIENCE_S,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (code, "late: interrupted\n" if code else "")


def test_only_what_is_imported_is_left_out_of_the_search_for_garbage() -> None:
    script = """
import gc
from cdrj_ros.foundation.interruption import run_interruptibly

def load():
    assert not gc.isenabled()
    return lambda: not (gc.isenabled() and gc.get_freeze_count() > 1000)

run_interruptibly("loaded", load)
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


@pytest.mark.parametrize(("chosen", "threads"), [({}, 1), ({BLAS_THREADS: "2"}, 2)])
def test_numpy_calculates_in_one_thread_unless_the_user_chose_more(
    chosen: dict[str, str], threads: int
) -> None:
    script = """
import os
from cdrj_ros.foundation.interruption import run_interruptibly

def load():
    import numpy

    def main():
        table = numpy.ones((500, 500))
        table @ table
        return 100 + len(os.listdir("/proc/self/task"))

    return main

run_interruptibly("counting", load)
"""
    kept = {name: value for name, value in os.environ.items() if name != BLAS_THREADS}
    done = subprocess.run([sys.executable, "-c", script], check=False, env=kept | chosen)
    watcher = 1  # waits for Ctrl-C
    assert done.returncode == 100 + min(threads, len(os.sched_getaffinity(0))) + watcher
