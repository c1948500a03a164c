"""Tasks on a Dask cluster of real worker processes, one of which is killed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from support.clusters import running_cluster
from support.many_tasks import killed_once, square

from cdrj_ros.campaign.cluster import check_address, on_cluster
from cdrj_ros.campaign.tasks import Failed, Work, in_this_process
from cdrj_ros.foundation.errors import UsageError

from .test_processes import kill_when_noted

pytest.importorskip("distributed", reason="Dask's distributed is not installed")
pytestmark = pytest.mark.filterwarnings("ignore")  # of Dask's own modules


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_cluster(tmp_path_factory.mktemp("cluster")) as address:
        yield address


def test_a_cluster_gives_the_results_of_one_process_and_names_what_failed(address: str) -> None:
    numbers = [3.0, -1.0, 7.0, 13.0, 0.3]
    work = Work(square, numbers, [f"bag {n:g}" for n in numbers], [10] * 5)
    done: list[float] = []
    assert on_cluster(work, address, done.append) == in_this_process(work, lambda _: None)
    assert done == [10.0, 20.0, 30.0, 40.0, 50.0]


def test_the_task_of_a_killed_worker_is_done_by_another(address: str, tmp_path: Path) -> None:
    notes = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    notes[0].write_text("no first attempt\n")
    notes[2].write_text("no first attempt\n")
    thread = kill_when_noted(notes[1])
    tasks = [str(path) for path in notes]
    results = on_cluster(Work(killed_once, tasks, tasks, [1, 1, 1]), address, lambda _: None)
    thread.join()
    assert results == ["a", "b", "c"]
    first, second = notes[1].read_text().split()
    assert first != second


def test_a_task_that_kills_every_worker_is_named_and_the_others_are_done(address: str) -> None:
    numbers = [1.0, 99.0, 2.0, 3.0]
    work = Work(square, numbers, [f"bag {n:g}" for n in numbers], [1] * 4)
    results = on_cluster(work, address, lambda _: None)
    assert results[1] == Failed("bag 99", "bag 99: every worker that processed it died")
    assert [one for one in results if not isinstance(one, Failed)] == [0.1, 0.4, 0.1 * 3.0 * 3.0]


def test_an_address_without_a_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cdrj_ros.campaign.cluster.CONNECT_S", 0.2)
    with pytest.raises(UsageError, match=r"tcp://127.0.0.1:1: no Dask scheduler answered"):
        on_cluster(Work(square, [1.0], ["one"], [1]), "tcp://127.0.0.1:1", lambda _: None)


@pytest.mark.parametrize("address", ["", "host", "host:port", "smtp://host:25", "tcp://:8786"])
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(UsageError, match="--scheduler must be the address"):
        check_address(address)
