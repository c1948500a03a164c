"""The end of an interrupted command: one line and its exit code."""

import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from support.places import ROBOT

from cdrj_ros._core import mark_unsure
from cdrj_ros.foundation.interruption import BLAS_THREADS, thread_pool
from cdrj_ros.model.packing import UNSURE
from cdrj_ros.model.prepared import load_model

PATIENCE_S = 30.0
PRELUDE = """
import atexit, os, signal, threading, time
from cdrj_ros.commands.entry import run_command
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.interruption import run_interruptibly
from cdrj_ros.foundation.interruption import thread_pool

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):  # Python handles signals between instructions
        pass
"""


def ended(program, closing=""):
    """Exit code, standard output and standard error of a program."""
    done = subprocess.run(
        ["bash", "-c", f'exec "$0" -c "$1" {closing}', sys.executable, PRELUDE + program],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False,
    )  # fmt: skip
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("code", [130, 0])
def test_an_interrupt_of_an_import_ends_the_command_though_the_import_catches_it(code):
    """A compiled module turns any exception during its import into an ImportError."""
    program = f"""
def load():
    try:
        interrupt()
    except BaseException:
        raise ImportError
    return print

run_interruptibly("importing", load, {code})
"""
    assert ended(program) == (code, "", "importing: interrupted\n")


def test_an_interrupted_command_cleans_up_and_keeps_what_it_printed():
    program = """
def body(_):
    try:
        print("begun")
        interrupt()
    finally:
        print("cleaned up")

run_interruptibly("working", lambda: lambda: run_command("working", body, []))
"""
    assert ended(program) == (130, "begun\ncleaned up\n", "working: interrupted\n")
    assert ended(program, "2>&-") == (130, "begun\ncleaned up\n", "")


def test_after_an_error_a_pool_of_threads_neither_waits_nor_begins_anything():
    begun, released = threading.Event(), threading.Event()

    def task():
        begun.set()
        released.wait(PATIENCE_S)

    def fail():
        with thread_pool(1) as pool:
            submitted.extend((pool.submit(task), pool.submit(task)))
            assert begun.wait(PATIENCE_S)
            raise ValueError("of the block")

    submitted = []
    with pytest.raises(ValueError, match="of the block"):
        fail()
    running, waiting = submitted
    assert running.running()
    assert waiting.cancelled()
    released.set()
    running.result(PATIENCE_S)


def test_an_interrupted_command_does_not_wait_for_its_threads():
    program = """
def main():
    with thread_pool(1) as pool:
        never = pool.submit(threading.Event().wait)
        pool.submit(os._exit, 1)  # has not begun, and is dropped
        interrupt()

run_interruptibly("waiting", lambda: main)
"""
    assert ended(program) == (130, "", "waiting: interrupted\n")


@pytest.mark.parametrize(("chosen", "threads"), [({}, 1), ({BLAS_THREADS: "2"}, 2)])
def test_numpy_calculates_in_one_thread_unless_the_user_chose_more(chosen, threads):
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
    assert done.returncode == 100 + min(threads, len(os.sched_getaffinity(0)))


def test_a_signal_ends_a_loop_of_the_core_over_a_recording():
    def ask(*_):
        raise InterruptedError

    model = load_model(ROBOT)
    values, nothing = np.zeros((200_000, model.layout.size)), np.empty((0, 0))
    doubted = np.ones((len(values), len(model.layout.elements)), dtype=np.bool_)

    def loop():
        signal.setitimer(signal.ITIMER_REAL, 1e-3)
        mark_unsure(model.core, values, nothing, 0.5, doubted)

    before = signal.signal(signal.SIGALRM, ask)
    try:
        with pytest.raises(InterruptedError):
            loop()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    status = values[:, model.layout.status]
    assert (status[0] == UNSURE).all()
    assert not status[-1].any()
