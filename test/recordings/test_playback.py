"""Invariants of the playback: order, completeness and time."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.recordings import RawMessage
from cdrj_ros.recordings.playback import MAX_RATE, MIN_RATE, Playback

S = 1_000_000_000


def _playback(times_ns: Sequence[int], rate: float | None = 1.0) -> Playback:
    messages = [RawMessage("/t", t, k.to_bytes(4, "little"), "") for k, t in enumerate(times_ns)]
    return Playback(messages, times_ns[0], times_ns[-1], rate=rate)


def _playing(times_ns: Sequence[int], rate: float | None = 1.0) -> Playback:
    playback = _playback(times_ns, rate)
    playback.start(0.0)
    return playback


def _numbers(messages: Sequence[RawMessage]) -> list[int]:
    return [int.from_bytes(message.data, "little") for message in messages]


def test_a_message_is_due_at_its_time_divided_by_the_rate() -> None:
    playback = _playing([0, 1 * S, 2 * S], rate=4.0)
    assert _numbers(playback.take(0.0, 10)) == [0]
    assert playback.wait_s(0.1) == pytest.approx(0.15)
    assert not playback.take(0.249, 10)
    assert _numbers(playback.take(0.25, 10)) == [1]


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), inf, MIN_RATE / 2, MAX_RATE * 2])
def test_an_invalid_rate_is_refused(rate: float) -> None:
    with pytest.raises(UsageError, match="rate must be in"):
        _playback([0], rate)


@given(
    st.lists(st.integers(0, 20 * S), min_size=1, max_size=60).map(sorted),
    st.lists(st.floats(0.0, 3.0), max_size=30),
    st.integers(1, 20),
    st.sampled_from([None, 0.1, 1.0, 50.0]),
)
def test_no_message_is_lost_repeated_out_of_order_or_early(
    times: list[int], waits: list[float], at_most: int, rate: float | None
) -> None:
    playback, now = _playing(times, rate), 0.0
    sent: list[int] = []
    position = playback.begin_ns
    steps = iter(waits)
    while not playback.ended:
        now += next(steps, playback.wait_s(now) + 1e-9)
        taken = playback.take(now, at_most)
        assert len(taken) <= at_most
        if rate is not None:
            assert all(m.log_ns - times[0] <= now * rate * 1e9 + 1 for m in taken)
        sent += _numbers(taken)
        assert playback.position_ns(now) >= position
        position = playback.position_ns(now)
        assert playback.ended or position <= times[len(sent)]
    assert sent == list(range(len(times)))


@pytest.mark.parametrize("rate", [1.0, None])
def test_nothing_is_due_before_the_start(rate: float | None) -> None:
    playback = _playback([0, S], rate)
    assert not playback.take(1e9, 10)
    assert playback.wait_s(1e9) == inf
