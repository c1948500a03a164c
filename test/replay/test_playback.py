"""Invariants of the playback under any requests: order, completeness and time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from math import inf

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cdrj_ros.bag import RawMessage
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.replay.playback import MAX_RATE, MIN_RATE, Playback

MS = 1_000_000
S = 1_000_000_000


def _message(number: int, log_ns: int) -> RawMessage:
    return RawMessage("/t", log_ns, number.to_bytes(4, "little"), "x/msg/X")


def _reel(times_ns: Sequence[int]) -> Callable[[int], Iterator[RawMessage]]:
    messages = [_message(k, t) for k, t in enumerate(times_ns)]
    return lambda start_ns: (m for m in messages if m.log_ns >= start_ns)


def _numbers(messages: Sequence[RawMessage]) -> list[int]:
    return [int.from_bytes(message.data, "little") for message in messages]


def _playing(times_ns: Sequence[int], rate: float | None = 1.0) -> Playback:
    playback = Playback(_reel(times_ns), times_ns[0], times_ns[-1], rate=rate)
    playback.start(0.0)
    return playback


def test_nothing_is_due_before_the_start() -> None:
    playback = Playback(_reel([0, MS]), 0, MS)
    assert not playback.take(1e9, 10)
    assert playback.wait_s(1e9) == inf


def test_a_message_is_due_at_its_time_divided_by_the_rate() -> None:
    playback = _playing([0, 1 * S, 2 * S], rate=4.0)
    assert _numbers(playback.take(0.0, 10)) == [0]
    assert playback.wait_s(0.1) == pytest.approx(0.15)
    assert not playback.take(0.249, 10)
    assert _numbers(playback.take(0.25, 10)) == [1]


def test_as_fast_as_possible_does_not_look_at_the_time() -> None:
    playback = _playing([0, 1 * S, 2 * S], rate=None)
    assert _numbers(playback.take(0.0, 2)) == [0, 1]
    assert playback.position_ns(0.0) == 1 * S
    assert _numbers(playback.take(0.0, 2)) == [2]
    assert playback.ended


def test_the_position_does_not_advance_while_paused() -> None:
    playback = _playing([0, 1 * S, 2 * S])
    playback.take(0.0, 10)
    playback.pause(0.4)
    assert playback.position_ns(100.0) == pytest.approx(0.4 * S, abs=2)
    assert playback.wait_s(100.0) == inf
    assert not playback.take(100.0, 10)
    playback.resume(100.0)
    assert not playback.take(100.59, 10)
    assert _numbers(playback.take(100.601, 10)) == [1]


def test_a_change_of_rate_does_not_change_the_position() -> None:
    playback = _playing([0, 10 * S])
    playback.take(0.0, 10)
    playback.set_rate(10.0, 2.0)
    assert playback.position_ns(2.0) == 2 * S
    assert playback.wait_s(2.0) == pytest.approx(0.8)


def test_the_delay_comes_before_the_first_message() -> None:
    playback = Playback(_reel([0, MS]), 0, MS)
    playback.start(5.0, delay_s=2.0)
    assert playback.wait_s(5.0) == pytest.approx(2.0)
    assert not playback.take(6.9, 10)
    assert _numbers(playback.take(7.0, 10)) == [0, 1]


def test_a_step_while_paused_sends_one_message_and_stays_paused() -> None:
    playback = _playing([0, 1 * S, 2 * S])
    playback.pause(0.0)
    playback.burst(1)
    assert _numbers(playback.take(0.0, 10)) == [0]
    assert not playback.take(9.0, 10)
    playback.burst(1)
    assert _numbers(playback.take(9.0, 10)) == [1]
    assert playback.position_ns(9.0) == 1 * S


def test_requests_that_arrive_before_the_next_messages_are_sent_add_up() -> None:
    playback = _playing([k * S for k in range(100)])
    playback.pause(0.0)
    for number in (1, 1, 3):
        playback.burst(number)
    assert _numbers(playback.take(0.0, 4)) == [0, 1, 2, 3]
    playback.burst(2)
    assert _numbers(playback.take(0.0, 10)) == [4, 5, 6]
    assert not playback.take(9.0, 10)
    playback.burst(0)
    playback.burst(1)
    assert len(playback.take(9.0, 100)) == 93


def test_after_a_burst_the_time_goes_on_from_its_last_message() -> None:
    playback = _playing([0, 1 * S, 2 * S, 3 * S])
    playback.burst(3)
    assert _numbers(playback.take(0.0, 10)) == [0, 1, 2]
    assert playback.wait_s(0.0) == pytest.approx(1.0)


def test_a_burst_of_zero_sends_all_that_is_left() -> None:
    playback = _playing([k * S for k in range(100)])
    playback.burst(0)
    sent: list[int] = []
    while not playback.ended:
        sent += _numbers(playback.take(0.0, 16))
    assert sent == list(range(100))


def test_after_a_seek_nothing_is_due_until_the_estimator_is_ready() -> None:
    playback = _playing([0, 1 * S, 2 * S, 3 * S])
    playback.take(0.0, 10)
    assert playback.seek(2 * S) == 2 * S
    assert not playback.take(50.0, 10)
    assert not playback.ended
    playback.resume_after_seek(50.0)
    assert _numbers(playback.take(50.0, 10)) == [2]
    assert playback.wait_s(50.0) == pytest.approx(1.0)


@pytest.mark.parametrize(("wanted", "reached"), [(-5 * S, 0), (99 * S, 3 * S)])
def test_a_seek_stays_within_what_is_played(wanted: int, reached: int) -> None:
    assert _playing([0, 1 * S, 2 * S, 3 * S]).seek(wanted) == reached


def test_a_seek_back_from_the_end_plays_on() -> None:
    playback = _playing([0, 1 * S], rate=None)
    playback.take(0.0, 10)
    assert playback.ended
    playback.seek(0)
    assert not playback.ended
    playback.resume_after_seek(0.0)
    assert _numbers(playback.take(0.0, 10)) == [0, 1]


def test_only_what_lies_between_start_and_end_is_played() -> None:
    playback = Playback(_reel([0, 1 * S, 2 * S, 3 * S, 4 * S]), 1 * S, 3 * S)
    playback.start(0.0)
    assert _numbers(playback.take(0.0, 10)) == [1, 2, 3]
    assert playback.ended


def test_every_pass_is_the_same() -> None:
    playback = _playing([0, 1 * S, 2 * S], rate=None)
    first = _numbers(playback.take(0.0, 10))
    playback.start(7.0)
    assert _numbers(playback.take(7.0, 10)) == first


def test_the_delay_of_taken_messages_is_reported() -> None:
    playback = _playing([0, 1 * S], rate=2.0)
    playback.take(0.0, 10)
    playback.take(0.75, 10)
    assert playback.behind_s == pytest.approx(0.25)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), inf, MIN_RATE / 2, MAX_RATE * 2])
def test_an_invalid_rate_is_refused_and_the_old_one_stays(rate: float) -> None:
    playback = _playing([0, 1 * S])
    with pytest.raises(UsageError, match="rate must be in"):
        playback.set_rate(rate, 0.0)
    assert playback.rate == 1.0


def test_an_end_before_the_start_is_refused() -> None:
    with pytest.raises(UsageError, match=r"the end lies 1\.000 s before the start"):
        Playback(_reel([0]), 2 * S, 1 * S)


ACTIONS = st.one_of(
    st.tuples(st.just("wait"), st.floats(0.0, 3.0)),
    st.tuples(st.just("pause"), st.none()),
    st.tuples(st.just("resume"), st.none()),
    st.tuples(st.just("burst"), st.integers(0, 5)),
    st.tuples(st.just("rate"), st.sampled_from([None, 0.1, 1.0, 50.0])),
)
TIMES = st.lists(st.integers(0, 20 * S), min_size=1, max_size=60).map(sorted)


def _act(playback: Playback, name: str, value: float | None, now: float) -> float:
    if name == "wait":
        return now + float(value or 0.0)
    if name == "pause":
        playback.pause(now)
    elif name == "resume":
        playback.resume(now)
    elif name == "burst":
        playback.burst(int(value or 0))
    else:
        playback.set_rate(value, now)
    return now


def _play_out(playback: Playback, now: float, at_most: int) -> list[int]:
    sent = []
    playback.resume(now)
    while not playback.ended:
        now += min(playback.wait_s(now), 1e6) + 1e-9
        sent += _numbers(playback.take(now, at_most))
    return sent


@settings(max_examples=150)
@given(TIMES, st.lists(ACTIONS, max_size=30), st.integers(1, 20))
def test_after_any_requests_no_message_is_lost_repeated_or_out_of_order(
    times: list[int], actions: list[tuple[str, float | None]], at_most: int
) -> None:
    playback, now = _playing(times), 0.0
    sent: list[int] = []
    position = playback.position_ns(now)
    for name, value in actions:
        now = _act(playback, name, value, now)
        sent += _numbers(playback.take(now, at_most))
        assert playback.position_ns(now) >= position  # the time never decreases without a seek
        position = playback.position_ns(now)
        if len(sent) < len(times):
            assert position <= times[len(sent)]  # nor exceeds that of the next message
    sent += _play_out(playback, now, at_most)
    assert sent == list(range(len(times)))


@settings(max_examples=100)
@given(TIMES, st.lists(ACTIONS, max_size=10), st.integers(-1 * S, 21 * S))
def test_after_a_seek_exactly_the_messages_from_there_on_are_sent(
    times: list[int], actions: list[tuple[str, float | None]], target: int
) -> None:
    playback, now = _playing(times), 0.0
    for name, value in actions:
        now = _act(playback, name, value, now)
        playback.take(now, 3)
    reached = playback.seek(target)
    playback.resume_after_seek(now)
    assert _play_out(playback, now, 7) == [k for k, t in enumerate(times) if t >= reached]
