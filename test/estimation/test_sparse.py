"""Readings that are too sparse for the motion are named with the rate that is enough."""

import re

import numpy as np
from support.places import ROBOT

from cdrj_ros.estimation.conditioner import condition
from cdrj_ros.evaluation.inputs import doubts_of
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.prepared import load_model


def read_at(model, rate_hz, motion_hz):
    """Half a minute of a swing, read at some rate."""
    time = np.arange(round(30.0 * rate_hz)) / rate_hz
    stamps = 1_700_000_000 * 10**9 + np.round(1e9 * time).astype(np.int64)
    elbow = 0.3 * np.sin(2.0 * np.pi * motion_hz * time)
    winch = 8.0 * np.sin(elbow)  # 0.12 m per radian on a drum of 15 mm
    return condition(
        model.robot,
        {"winch": Series(stamps, stamps, winch)},
        {"elbow": Series(stamps, stamps, elbow)},
    )


def test_five_readings_a_second_are_named_with_a_rate_that_is_enough():
    model = load_model(ROBOT)
    assert doubts_of(model, read_at(model, 200.0, 0.5)) == []
    (note,) = doubts_of(model, read_at(model, 5.0, 0.5))
    assert note.startswith("winch, elbow read at 5 Hz: too sparse for this motion, which between")
    found = re.search(r"worth (\d+)% of a preload; (\d+) Hz do\.$", note)
    share, enough = map(int, found.groups())
    assert share > 10, "alone makes them UNSURE"
    assert 5 < enough < 200
    assert doubts_of(model, read_at(model, 1.05 * enough, 0.5)) == []
    assert doubts_of(model, read_at(model, 5.0, 0.01)) == [], "five are enough for a slow motion"
