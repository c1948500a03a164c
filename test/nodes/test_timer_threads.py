"""The middleware's timer threads do not interrupt a publication."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from cdrj_ros.nodes.timer_threads import calm_timers


def policies(process: int) -> dict[str, set[int]]:
    """Scheduling policies of the threads of a process, by name."""
    found: dict[str, set[int]] = {}
    for task in Path(f"/proc/{process}/task").iterdir():
        with suppress(OSError):  # the thread has ended
            name = (task / "comm").read_text().strip()
            found.setdefault(name, set()).add(os.sched_getscheduler(int(task.name)))
    return found


@pytest.fixture
def thread() -> Iterator[Callable[[str, int], None]]:
    """Start threads with a name and a policy of their own, which wait for the end of the test."""
    done, started = threading.Event(), []

    def wait(name: str, policy: int, ready: threading.Event) -> None:
        Path(f"/proc/self/task/{threading.get_native_id()}/comm").write_text(name)
        os.sched_setscheduler(0, policy, os.sched_param(0))
        ready.set()
        done.wait()

    def start(name: str, policy: int) -> None:
        ready = threading.Event()
        one = threading.Thread(target=wait, args=(name, policy, ready), daemon=True)
        one.start()
        started.append(one)
        assert ready.wait(60.0)

    yield start
    done.set()
    for one in started:
        one.join()


def test_only_timer_threads_that_have_no_policy_of_their_own_change(
    thread: Callable[[str, int], None],
) -> None:
    thread("timer.x.0", os.SCHED_OTHER)
    thread("timer.x.1", os.SCHED_IDLE)
    thread("worker.x", os.SCHED_OTHER)
    assert calm_timers("timer.x") == 1
    assert calm_timers("timer.x") == 0
    found = policies(os.getpid())
    assert found["timer.x.0"] == {os.SCHED_BATCH}
    assert found["timer.x.1"] == {os.SCHED_IDLE}
    assert found["worker.x"] == {os.SCHED_OTHER}


def test_the_timer_thread_of_a_node_is_a_batch_thread(
    ros: None, start_node: Any, wait_until: Any
) -> None:
    process = start_node("estimator", "--ros-args", "-p", "robot:=prototype")

    def is_calm() -> bool:
        assert process.poll() is None
        found = policies(process.pid)
        timers = {policy for name in found if name.startswith("dds.ev") for policy in found[name]}
        return timers == {os.SCHED_BATCH}

    assert wait_until(is_calm, 60.0)
    assert os.sched_getscheduler(process.pid) == os.SCHED_OTHER
