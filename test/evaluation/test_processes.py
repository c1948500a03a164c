"""Many tasks: the same results in any number of processes, whatever fails or dies."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import pytest
from support.many_tasks import killed_once, noted, square

from cdrj_ros.evaluation.parallel import (
    WORTH_PROCESSES,
    Failed,
    Work,
    default_jobs,
    in_processes,
    in_this_process,
    processors,
)


def work(tasks: list[float]) -> Work[float, float]:
    return Work(square, tasks, [f"bag {task:g}" for task in tasks], [10] * len(tasks))


def kill_when_noted(path: Path) -> threading.Thread:
    """Kill the process that notes itself in a file, by its id."""

    def watch() -> None:
        pause = threading.Event()
        while not (path.exists() and path.read_text().endswith("\n")):
            pause.wait(0.01)
        os.kill(int(path.read_text()), signal.SIGKILL)

    thread = threading.Thread(target=watch)
    thread.start()
    return thread


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_results_are_in_the_order_of_the_tasks_and_a_failure_costs_only_its_own(jobs: int) -> None:
    done: list[float] = []
    tasks = work([3.0, -1.0, 7.0, 13.0, 0.3])
    results = in_processes(tasks, jobs, done.append)
    assert results == in_this_process(tasks, lambda _: None)
    assert results == [
        0.1 * 3.0 * 3.0,
        Failed("bag -1", "-1.0 is no bag"),
        0.1 * 7.0 * 7.0,
        Failed("bag 13", "unexpected ValueError: a bug of two lines"),
        0.1 * 0.3 * 0.3,
    ]
    assert done[-1] == 50.0


def test_a_task_that_kills_its_process_is_named_and_the_others_are_done() -> None:
    results = in_processes(work([1.0, 99.0, 2.0, 3.0]), 2, lambda _: None)
    assert [one for one in results if not isinstance(one, Failed)] == [0.1, 0.4, 0.1 * 3.0 * 3.0]
    failed = results[1]
    assert isinstance(failed, Failed)
    assert failed.name == "bag 99"
    assert failed.reason == "bag 99: its process died, twice (out of memory?)"


def test_the_task_of_a_process_killed_from_outside_is_done_by_another(tmp_path: Path) -> None:
    notes = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    notes[0].write_text("no first attempt\n")
    notes[2].write_text("no first attempt\n")
    thread = kill_when_noted(notes[1])
    tasks = [str(path) for path in notes]
    results = in_processes(Work(killed_once, tasks, tasks, [1, 1, 1]), 2, lambda _: None)
    thread.join()
    assert results == ["a", "b", "c"]
    first, second = notes[1].read_text().split()
    assert first != second


def test_processes_are_used_by_default_only_where_they_pay_off() -> None:
    assert default_jobs([1000] * 100) == 1
    assert default_jobs([WORTH_PROCESSES]) == 1
    assert default_jobs([WORTH_PROCESSES] * 1000) == processors()


def test_large_tasks_begin_first(tmp_path: Path) -> None:
    note = str(tmp_path / "note")
    tasks = [(note, name) for name in ("small", "large", "middle")]
    names = [name for _, name in tasks]
    assert in_processes(Work(noted, tasks, names, [1, 3, 2]), 1, lambda _: None) == names
    assert Path(note).read_text().split() == ["large", "middle", "small"]
