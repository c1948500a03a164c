"""Recordings of robots with joints without encoder."""

from __future__ import annotations

import numpy as np
import pytest
from support.motor_alone import without_encoder
from support.places import SAMPLE

from cdrj_ros.evaluation.inputs import read_encoderless
from cdrj_ros.evaluation.validation import BagTask, compare_bag
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.recordings import Topics

BAG = str(SAMPLE)


def test_efforts_are_inputs_and_the_recorded_angle_is_a_reference() -> None:
    model = without_encoder("prototype", "elbow")
    compared = compare_bag(BagTask(BAG, Topics(), window=(1.0, 20.0)), model=model)
    channels = {channel.name: channel for channel in compared.channels}
    assert "effort/winch" not in channels
    assert "effort/winch is an input here, and not compared." in compared.notes
    angle = channels["angle/elbow"]
    assert angle.unit == "rad"
    assert np.sqrt(np.mean((angle.estimate - angle.reference) ** 2)) < 5e-3
    assert np.ptp(angle.reference) > 0.5
    assert angle.stddev is not None


def test_a_bag_without_efforts_is_refused() -> None:
    robot = without_encoder("prototype", "elbow").robot
    with pytest.raises(BagError, match="no efforts of winch, from which elbow"):
        read_encoderless(BAG, Topics(references=()), robot)
