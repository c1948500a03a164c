"""Many tasks: the same results in this process and in others, and none lost to another."""

import os
import signal
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import joblib
import pytest
import support.many_tasks
from support.many_tasks import killed_once, noted, square
from support.places import ROBOT, SAMPLE

import cdrj_ros as cdrj
from cdrj_ros.evaluation.parallel import (
    WORTH_PROCESSES,
    Failed,
    Work,
    default_jobs,
    processors,
    results_of,
)


@contextmanager
def killed_when_noted(note):
    """Kill the process that notes its id in a file."""

    def kill():
        pause = Event()
        while not (note.exists() and note.read_text().endswith("\n")):
            pause.wait(0.01)
        os.kill(int(note.read_text()), signal.SIGKILL)

    thread = Thread(target=kill)
    thread.start()
    yield
    thread.join()


@pytest.mark.parametrize("jobs", [2, 5])
def test_results_are_in_the_order_of_the_tasks_and_a_failure_costs_only_its_own(jobs):
    """Also one that kills its process."""
    done = []
    tasks = [3.0, -1.0, 99.0, 13.0, 0.3]
    work = Work(square, tasks, [f"bag {task:g}" for task in tasks], [10] * len(tasks))
    results = results_of(work, jobs, done.append)
    assert results == [
        0.1 * 3.0 * 3.0,
        Failed("bag -1", "-1.0 is no bag"),
        Failed("bag 99", "bag 99: its process died, twice (out of memory?)"),
        Failed("bag 13", "unexpected ValueError: a bug of two lines"),
        0.1 * 0.3 * 0.3,
    ]
    assert done[-1] == 50.0
    good = Work(square, tasks[:2], ["bag 3", "bag -1"], [1, 2])
    assert results_of(good, 1, done.append) == results[:2]
    assert done[-2:] == [2, 3]


def test_the_task_of_a_process_killed_from_outside_is_done_by_another(tmp_path):
    notes = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    notes[0].write_text("no first attempt\n")
    notes[2].write_text("no first attempt\n")
    tasks = [str(path) for path in notes]
    with killed_when_noted(notes[1]):
        results = results_of(Work(killed_once, tasks, tasks, [1, 1, 1]), 2, lambda _: None)
    assert results == ["a", "b", "c"]
    first, second = notes[1].read_text().split()
    assert first != second


def test_joblib_says_where_tasks_run():
    """Also a backend that returns all results at the end, as Ray's does."""
    tasks = [3.0, -1.0, 13.0, 0.3]
    work = Work(square, tasks, [f"bag {task:g}" for task in tasks], [1, 1, 1, 1])
    here = results_of(work, 1, lambda _: None)
    for backend in ("threading", "multiprocessing"):
        with joblib.parallel_config(backend=backend):
            assert results_of(work, 2, lambda _: None) == here


def test_a_dask_cluster_gives_the_same_results_when_a_worker_dies(tmp_path, monkeypatch):
    distributed = pytest.importorskip("dask.distributed")
    monkeypatch.setenv("PYTHONPATH", str(Path(support.many_tasks.__file__).parents[1]))
    tasks = [str(tmp_path / "first"), str(tmp_path / "second"), str(tmp_path / "third")]
    for kept in (tasks[0], tasks[2]):
        Path(kept).write_text("no first attempt\n")
    squares = Work(square, [3.0, -1.0, 13.0, 0.3], ["a", "b", "c", "d"], [1, 1, 1, 1])
    done = []
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as here,
        distributed.Client(here),
        joblib.parallel_config(backend="dask"),
    ):
        assert processors() == 2
        assert results_of(squares, 1, done.append) == [
            0.1 * 3.0 * 3.0,
            Failed("b", "-1.0 is no bag"),
            Failed("c", "unexpected ValueError: a bug of two lines"),
            0.1 * 0.3 * 0.3,
        ]
        assert done == [1, 2, 3, 4]
        compared = cdrj.validate(ROBOT, [SAMPLE, SAMPLE], uncertainty=False)
        with killed_when_noted(Path(tasks[1])):
            results = results_of(Work(killed_once, tasks, tasks, [1, 1, 1]), 1, done.append)
    assert results == ["first", "second", "third"]
    first, second = Path(tasks[1]).read_text().split()
    assert first != second
    here_alone = cdrj.validate(ROBOT, [SAMPLE, SAMPLE], uncertainty=False)
    assert compared.pooled == here_alone.pooled


def test_processes_are_used_by_default_only_where_they_pay_off():
    assert default_jobs([1000] * 100) == 1
    assert default_jobs([WORTH_PROCESSES]) == 1
    assert default_jobs([WORTH_PROCESSES] * 1000) == processors()


def test_large_tasks_begin_first(tmp_path):
    note = str(tmp_path / "note")
    tasks = [(note, name) for name in ("small", "large", "middle")]
    names = [name for _, name in tasks]
    assert results_of(Work(noted, tasks, names, [1, 3, 2]), 1, lambda _: None) == names
    assert Path(note).read_text().split() == ["large", "middle", "small"]
