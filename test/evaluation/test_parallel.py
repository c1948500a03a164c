"""Many tasks: the same results in this process, in others, and on a Dask cluster of real ones."""

from __future__ import annotations

import json
import os
import signal
import socketserver
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest
from support.clusters import running_cluster
from support.many_tasks import killed_once, noted, square, sum_after_death, sum_with
from support.places import ROOT

from cdrj_ros.commands import validate
from cdrj_ros.evaluation.parallel import (
    WORTH_PROCESSES,
    Failed,
    Work,
    check_address,
    cluster_pool,
    connected,
    default_jobs,
    in_processes,
    in_this_process,
    on_cluster,
    processors,
)
from cdrj_ros.foundation.errors import CdrjError, UsageError

pytestmark = pytest.mark.filterwarnings("ignore")  # of Dask's own modules

Run = Callable[[Work[Any, Any]], list[Any]]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    pytest.importorskip("distributed", reason="Dask's distributed is not installed")
    with running_cluster(tmp_path_factory.mktemp("cluster")) as address:
        yield address


@pytest.fixture(params=["processes", "cluster"])
def run(request: pytest.FixtureRequest) -> Run:
    """Do tasks in two other processes."""
    if request.param == "processes":
        return lambda work: list(in_processes(work, 2, lambda _: None))
    there = request.getfixturevalue("address")
    return lambda work: list(on_cluster(work, there, lambda _: None))


def work(tasks: list[float]) -> Work[float, float]:
    return Work(square, tasks, [f"bag {task:g}" for task in tasks], [10] * len(tasks), float)


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


def test_a_task_that_kills_its_process_is_named_and_the_others_are_done(run: Run) -> None:
    results = run(work([1.0, 99.0, 2.0, 3.0]))
    assert results[1] == Failed("bag 99", "bag 99: its process died, twice (out of memory?)")
    assert [one for one in results if not isinstance(one, Failed)] == [0.1, 0.4, 0.1 * 3.0 * 3.0]


def test_what_a_worker_returns_instead_of_a_result_is_a_failure(run: Run) -> None:
    results = run(work([1.0, 66.0]))
    assert results == [0.1, Failed("bag 66", "bag 66: a worker returned dict, not float")]


def test_the_task_of_a_process_killed_from_outside_is_done_by_another(
    run: Run, tmp_path: Path
) -> None:
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
    results = run(Work(killed_once, tasks, tasks, [1, 1, 1], str))
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
    assert in_processes(Work(noted, tasks, names, [1, 3, 2], str), 1, lambda _: None) == names
    assert Path(note).read_text().split() == ["large", "middle", "small"]


def figures(path: Path, *arguments: str) -> dict[str, Any]:
    """What ``validate`` writes for three bags, without the time that it took."""
    bags = [str(ROOT / "bags" / f"prototype_preload_{name}") for name in ("36_26", "23_6", "36_26")]
    short = ["--robot", "prototype", "--duration", "3", "--json", str(path)]
    assert validate.main([*bags, *short, *arguments]) == 0
    found: dict[str, Any] = json.loads(path.read_text())
    for bag in found["bags"]:
        del bag["facts"]["time"]
    return found


def test_validate_has_the_figures_of_this_process(address: str, tmp_path: Path) -> None:
    here = figures(tmp_path / "here.json", "--jobs", "1")
    assert figures(tmp_path / "there.json", "--scheduler", address) == here


def test_pairs_have_the_results_of_this_process_in_their_order(address: str) -> None:
    tables = [np.arange(1000.0), np.arange(10.0)]
    pairs = [(0.1, tables[0]), (0.2, tables[1]), (0.3, tables[0])]
    with cluster_pool(address) as pool:
        for _ in range(2):
            found = pool.map(sum_with, *zip(*pairs, strict=True))
            assert found == [sum_with(*pair) for pair in pairs]
        with pytest.raises(CdrjError, match=r"-1\.0 is no number"):
            pool.map(sum_with, [1.0, -1.0], tables)


def test_an_argument_that_died_with_its_worker_is_sent_again(address: str, tmp_path: Path) -> None:
    table = np.arange(100.0)
    with cluster_pool(address) as pool:
        notes = [str(tmp_path / "a"), str(tmp_path / "b")]
        assert pool.map(sum_after_death, notes, [table, table]) == [4950.0, 4950.0]


def test_an_address_without_a_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("cdrj_ros.evaluation.parallel.CONNECT_S", 0.2)
    with pytest.raises(UsageError, match=r"tcp://127.0.0.1:1: no Dask scheduler answered"):
        on_cluster(Work(square, [1.0], ["one"], [1], float), "tcp://127.0.0.1:1", lambda _: None)


@pytest.mark.parametrize("address", ["", "host", "host:port", "smtp://host:25", "tcp://:8786"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="--scheduler must be the address"):
        check_address(address)


@pytest.mark.parametrize("said", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n" * 9])
def test_a_port_at_which_something_else_listens_is_refused(
    said: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("cdrj_ros.evaluation.parallel.CONNECT_S", 0.2)

    class Other(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            self.request.sendall(said)
            self.request.recv(1_000_000)
            over.wait()

    over = Event()
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Other) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        with pytest.raises(UsageError, match="no Dask scheduler answered"):
            connected(f"tcp://127.0.0.1:{server.server_address[1]}").__enter__()
        over.set()
        server.shutdown()
