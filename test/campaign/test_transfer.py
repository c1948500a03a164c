"""Results of other processes arrive as they were sent, their arrays in shared memory."""

from __future__ import annotations

from collections.abc import Iterator
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdrj_ros.campaign.tasks import Failed
from cdrj_ros.campaign.transfer import Envelope, receive_large, send_large

Ends = tuple[Connection, Connection]


@pytest.fixture
def ends() -> Iterator[Ends]:
    """Both ends of a connection."""
    here, there = Pipe()
    yield here, there
    here.close()
    there.close()


def transferred(ends: Ends, value: Any) -> Any:
    here, there = ends
    send_large(there, "kind", value)
    kind, envelope = here.recv()
    assert kind == "kind"
    assert isinstance(envelope, Envelope)
    return receive_large(here, envelope)


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize(
    "value",
    [
        None,
        Failed("bag", "why"),
        np.empty(0),
        [np.empty((0, 3)), np.arange(5.0)],
        {"a": np.arange(7), "b": (np.array([True, False, True]), "text")},
        np.arange(24.0).reshape(4, 6)[:, ::2],
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.frombuffer(b"12345678", np.uint8),
    ],
)
def test_an_object_arrives_as_it_was_sent(ends: Ends, value: Any) -> None:
    np.testing.assert_equal(transferred(ends, value), value)


def test_arrays_larger_than_a_pipe_can_be_changed_and_outlive_the_connection(ends: Ends) -> None:
    sent = [np.random.default_rng(k).random(500_001) for k in range(3)]
    before = open_files()
    arrived = transferred(ends, sent)
    assert open_files() <= before + 1  # that of the mapping
    for end in ends:
        end.close()
    for one, other in zip(arrived, sent, strict=True):
        assert one.flags.aligned
        np.testing.assert_array_equal(one, other)
        one[:] = 0.0
    assert all(one.any() for one in sent)


def test_a_sender_that_dies_before_the_arrays_are_sent_is_noticed(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = ends

    def die(*_: object) -> None:
        there.close()
        raise KeyboardInterrupt

    monkeypatch.setattr("cdrj_ros.campaign.transfer.send_handle", die)
    before = open_files()
    with pytest.raises(KeyboardInterrupt):
        send_large(there, "kind", np.ones(9))
    assert open_files() == before - 1  # the connection
    _, envelope = here.recv()
    with pytest.raises((EOFError, OSError)):
        receive_large(here, envelope)
