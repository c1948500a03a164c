"""Keys and requests, and the restoration of the terminal.  Does not depend on ROS."""

from __future__ import annotations

import os
import pty
import termios
from collections.abc import Iterator

import pytest

from cdrj_ros.bag import RawMessage
from cdrj_ros.replay.controls import IDLE, KEYS, RATES, Controls
from cdrj_ros.replay.keyboard import Keyboard
from cdrj_ros.replay.playback import Playback

S = 1_000_000_000


@pytest.fixture
def controls() -> Controls:
    messages = [RawMessage("/t", k * S, b"", "") for k in range(31)]
    controls = Controls(clock=lambda: 0.0)
    playback = Playback(
        lambda start: (m for m in messages if m.log_ns >= start), 0, 30 * S, rate=1.0
    )
    playback.start(0.0)
    controls.playback = playback
    return controls


def test_without_a_playback_every_key_but_quit_reports_that_nothing_is_played() -> None:
    for key in (" ", "n", "right", "+", "up", "-", "down", "f", "left", "[", "]"):
        assert Controls().press(key) == IDLE


def test_keys_without_a_meaning_do_nothing(controls: Controls) -> None:
    assert controls.press("z") is None


def test_every_key_of_the_help_has_a_meaning(controls: Controls) -> None:
    named = {"space": " ", "→": "right", "↑": "up", "↓": "down", "←": "left"}
    words = KEYS.replace("10 s", "").split()
    for word in (w for w in words if w in named or (len(w) == 1 and w != "·")):
        assert controls.press(named.get(word, word)) is not None, word


def test_space_pauses_and_resumes(controls: Controls) -> None:
    assert controls.press(" ") == (True, "paused at 0.000 s of 30.000 s")
    assert controls.is_paused().done
    assert controls.press(" ") == (
        True, "playing on from 0.000 s of 30.000 s, 1 x real time"
    )  # fmt: skip
    assert not controls.is_paused().done


def test_a_step_is_refused_while_playing(controls: Controls) -> None:
    done, words = controls.play_next()
    assert not done
    assert "pause first" in words


def test_a_seek_beyond_the_end_is_limited_and_reported(controls: Controls) -> None:
    done, words = controls.seek(99.0)
    assert done
    assert words.startswith("moved to 30.000 s of 30.000 s (there is no more on that side)")


def test_a_seek_back_is_relative_to_the_current_position(controls: Controls) -> None:
    controls.seek(25.0)
    assert "moved to 15.000 s" in controls.seek(-10.0, relative=True).words


@pytest.mark.parametrize("offset", [float("nan"), float("inf"), 1e12])
def test_a_seek_to_an_invalid_offset_is_refused(controls: Controls, offset: float) -> None:
    assert not controls.seek(offset).done
    assert controls.playback is not None
    assert not controls.playback.sought


@pytest.mark.parametrize("rate", [-1.0, float("nan"), 1e9])
def test_an_invalid_rate_is_refused_with_a_reason(controls: Controls, rate: float) -> None:
    done, words = controls.set_rate(rate)
    assert not done
    assert "rate must be in" in words


def test_faster_and_slower_go_through_all_rates_and_back(controls: Controls) -> None:
    assert controls.playback is not None
    seen = []
    while controls.playback.rate is not None:
        seen.append(controls.playback.rate)
        controls.faster()
    assert tuple(seen) == RATES[RATES.index(1.0) :]
    controls.slower()
    assert controls.playback.rate == 1.0
    for _ in RATES:
        controls.slower()
    assert controls.playback.rate == RATES[0]


def test_a_key_pressed_twice_before_the_next_message_steps_twice(controls: Controls) -> None:
    assert controls.playback is not None
    controls.press(" ")
    for _ in range(2):
        reply = controls.press("n")
        assert reply is not None
        assert reply.done
    assert len(controls.playback.take(0.0, 100)) == 2


def test_a_burst_at_the_end_is_refused(controls: Controls) -> None:
    assert controls.playback is not None
    assert controls.burst(0).done
    controls.playback.take(0.0, 100)
    assert not controls.burst(3).done


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, int]]:
    """The two ends of a terminal with this process in its foreground."""
    keys, screen = pty.openpty()
    monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp())
    yield keys, screen
    os.close(keys)
    os.close(screen)


def test_keys_come_one_by_one_without_enter(terminal: tuple[int, int]) -> None:
    keys, screen = terminal
    keyboard = Keyboard(screen)
    with keyboard.listening() as there:
        assert there
        os.write(keys, b" n\x1b[A\x1bOD+q")
        assert keyboard.read() == [" ", "n", "up", "left", "+", "q"]
        assert keyboard.read() == []


def test_an_arrow_key_that_comes_in_two_parts_is_one_key(terminal: tuple[int, int]) -> None:
    keys, screen = terminal
    keyboard = Keyboard(screen)
    with keyboard.listening():
        os.write(keys, b"\x1b[")
        assert keyboard.read() == []
        os.write(keys, b"C")
        assert keyboard.read() == ["right"]


def test_the_terminal_is_restored_even_after_an_error(
    terminal: tuple[int, int],
) -> None:
    _, screen = terminal
    before = termios.tcgetattr(screen)
    during = []

    def fail() -> None:
        with Keyboard(screen).listening():
            during.append(termios.tcgetattr(screen))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert during != [before]
    assert termios.tcgetattr(screen) == before


def test_a_pipe_is_not_read_as_a_keyboard() -> None:
    reader, writer = os.pipe()
    keyboard = Keyboard(reader)
    os.write(writer, b"q")
    with keyboard.listening() as there:
        assert not there
        assert keyboard.read() == []
    os.close(reader)
    os.close(writer)
