"""The strands across the rolling joint against virtual work."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import load_robot
from examples.paper.strands import RollingStrands

ROBOT = Path(__file__).parents[2] / "config" / "robots" / "prototype.yaml"
ANGLES = np.linspace(-0.7, 0.7, 29)


def test_strands_keep_their_sum_and_their_angle_comes_back() -> None:
    strands = RollingStrands(strands=3, distance=0.09, width=0.05)
    up, down = strands.lengths(ANGLES)
    np.testing.assert_allclose(up + down, 2 * 3 * 0.09)
    np.testing.assert_allclose(strands.angle((down - up) / 2), ANGLES, atol=1e-15)
    assert np.all(np.diff(up) < 0.0), "a positive angle shortens the upper strands"
    with pytest.raises(UsageError, match=r"must be in \[-0.15, 0.15\] m"):
        strands.angle(np.array([0.0, 0.151]))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_amplification_keeps_the_work_and_gives_n_squared_the_stiffness(count: int) -> None:
    strands, tension, travel = RollingStrands(strands=count), 17.0, 2e-3
    work_out = strands.output_tension(tension) * strands.output_travel(travel)
    assert work_out == pytest.approx(tension * travel)
    stiffness = strands.output_tension(tension) / strands.output_travel(travel)
    assert strands.output_stiffness(tension / travel) == pytest.approx(stiffness)
    assert stiffness == pytest.approx(count**2 * tension / travel)


def test_torque_is_the_virtual_work_of_the_strands() -> None:
    strands, small = RollingStrands(strands=4, width=0.07), 1e-6
    upper, lower = 55.0, 31.0  # of one cable each, the same in all its strands
    up, down = (
        (ahead - behind) / (2 * small)
        for ahead, behind in zip(
            strands.lengths(ANGLES + small), strands.lengths(ANGLES - small), strict=True
        )
    )
    torque = strands.torque(ANGLES, strands.output_tension(upper), strands.output_tension(lower))
    np.testing.assert_allclose(torque, -(upper * up + lower * down), rtol=1e-8)
    difference = strands.tension_difference(ANGLES, torque)
    np.testing.assert_allclose(difference, 4 * (upper - lower))
    printed = replace(strands, form="published")
    np.testing.assert_allclose(printed.tension_difference(ANGLES, torque), 2 * difference)


def test_torque_of_the_prototypes_strands_is_that_of_its_lever_arms() -> None:
    prototype = load_robot(ROBOT)
    model, strands = prepare(prototype), RollingStrands()
    tension = np.concatenate([np.full(8, 37.0), np.full(8, 22.0)])
    sixth = prototype.cables[0].pulleys[4]
    profile = next(p for p in sixth.wrap if p.joint is not None)
    for angle in ANGLES[2:-2]:
        arms = shape_at(model, np.array([angle])).lever_arm[:, 0]
        virtual = -tension @ arms
        # pulley 6 adds what (3) leaves out: its arc grows with the joint, in both cables mirrored
        slope = np.interp(angle, profile.angle, profile.slope)
        arc = sixth.radius * slope * (37.0 - 22.0)
        assert virtual + arc == pytest.approx(
            float(strands.torque(angle, 2 * 37.0, 2 * 22.0)), rel=1e-9
        )


def test_impossible_strands_are_refused() -> None:
    with pytest.raises(UsageError, match="form must be one of corrected, published"):
        RollingStrands(form="printed")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="must be at least 1, got 0"):
        RollingStrands(strands=0)
    with pytest.raises(UsageError, match="width must be positive, got -1"):
        RollingStrands(width=-1.0)
