"""A pool of threads that is not waited for after an error."""

from __future__ import annotations

from threading import Event

import pytest

from cdrj_ros.foundation.interruption import thread_pool

PATIENCE_S = 30.0


def test_a_pool_finishes_what_was_submitted() -> None:
    done: list[int] = []
    with thread_pool(2) as pool:
        for k in range(20):
            pool.submit(done.append, k)
    assert sorted(done) == list(range(20))


def test_after_an_error_a_pool_neither_waits_nor_begins_anything() -> None:
    begun, released = Event(), Event()

    def task() -> None:
        begun.set()
        released.wait(PATIENCE_S)

    submitted = []

    def fail() -> None:
        with thread_pool(1) as pool:
            submitted.extend((pool.submit(task), pool.submit(task)))
            assert begun.wait(PATIENCE_S)
            raise ValueError("of the block")

    with pytest.raises(ValueError, match="of the block"):
        fail()
    running, waiting = submitted
    assert running.running()
    assert waiting.cancelled()
    released.set()
    running.result(PATIENCE_S)
