"""A recording plays at its rate, stops at its end, and is drawn only while somebody watches."""

from unittest.mock import MagicMock

import numpy as np
import pytest

from cdrj_ros.view import recorded as players
from cdrj_ros.view.recorded import Player


@pytest.fixture
def clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(players, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def player(clock):
    page, estimates = MagicMock(), MagicMock()
    page.watched = True
    page.settings.return_value = ()
    page.plot_is_due.return_value = True
    page.gui.add_dropdown.return_value.value = "2"
    estimates.duration_s = 4.0
    estimates.at.side_effect = lambda time_s: MagicMock(stamp_ns=round(time_s * 1e9))
    return Player(page, estimates, "bag")


def drawn(player):
    page = player.page
    return [call.args[3] for call in page.show.call_args_list]


def test_time_passes_at_the_chosen_rate_up_to_the_end(player, clock):
    for _ in range(5):
        clock[0] += 0.5
        player.tick()
    np.testing.assert_allclose(np.array(drawn(player)) * 1e-9, [1.0, 2.0, 3.0, 4.0])
    assert not player.playing
    player.play(True)
    clock[0] += 0.25
    player.tick()
    assert player.time_s == pytest.approx(0.5)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308, -1e308])
def test_what_a_page_may_send_leaves_the_time_within_the_recording(value, player, clock):
    """A page of its own may send any number for the slider, and any text for the rate."""
    page = player.page
    slider, rate = page.gui.add_slider.return_value, page.gui.add_dropdown.return_value
    (moved,), _ = slider.on_update.call_args
    slider.value, slider.max, rate.value = value, value, str(value)
    moved(MagicMock())
    player.tick()
    rate.value = "1"
    clock[0] += 0.5
    player.tick()
    assert 0.0 <= player.time_s <= 4.0
    assert 0.0 <= slider.value <= 4.0


def test_a_picture_that_does_not_change_is_not_drawn_again(player, clock):
    player.play(False)
    for _ in range(3):
        clock[0] += 1.0
        player.tick()
    assert drawn(player) == [0]
    player.page.chosen = "pulley upper/2"
    player.tick()
    assert drawn(player) == [0, 0]


def test_nothing_is_drawn_while_nobody_watches(player, clock):
    player.page.watched = False
    clock[0] += 1.0
    player.tick()
    assert drawn(player) == []
    assert player.time_s == 0.0
