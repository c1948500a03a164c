"""Many tasks: the same results in this process and in others, and none lost to another."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from threading import Event, Thread

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


@pytest.mark.parametrize("jobs", [1, 2, 5])
def test_results_are_in_the_order_of_the_tasks_and_a_failure_costs_only_its_own(jobs: int) -> None:
    """Also one that kills its process."""
    done: list[float] = []
    tasks = [3.0, -1.0, 99.0, 13.0, 0.3]
    work = Work(square, tasks, [f"bag {task:g}" for task in tasks], [10] * len(tasks))
    results = in_processes(work, jobs, done.append)
    assert results == [
        0.1 * 3.0 * 3.0,
        Failed("bag -1", "-1.0 is no bag"),
        Failed("bag 99", "bag 99: its process died, twice (out of memory?)"),
        Failed("bag 13", "unexpected ValueError: a bug of two lines"),
        0.1 * 0.3 * 0.3,
    ]
    assert done[-1] == 50.0
    good = Work(square, tasks[:2], ["bag 3", "bag -1"], [1, 2])
    assert in_this_process(good, done.append) == results[:2]
    assert done[-2:] == [1, 3]


def test_the_task_of_a_process_killed_from_outside_is_done_by_another(tmp_path: Path) -> None:
    notes = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    notes[0].write_text("no first attempt\n")
    notes[2].write_text("no first attempt\n")

    def kill_when_noted() -> None:
        """Kill the process that notes itself in the second file, by its id."""
        pause = Event()
        while not (notes[1].exists() and notes[1].read_text().endswith("\n")):
            pause.wait(0.01)
        os.kill(int(notes[1].read_text()), signal.SIGKILL)

    thread = Thread(target=kill_when_noted)
    thread.start()
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
