"""The example that gives a MuJoCo model's tendon friction."""

import runpy

import numpy as np
import pytest
from support.places import ROOT

pytest.importorskip("mujoco", reason="MuJoCo is not installed")

EXAMPLE = runpy.run_path(str(ROOT / "examples" / "mujoco_bridge.py"))
DAMPING, TIMESTEP_S = 0.05, 0.0005
"""Of the example's model."""


@pytest.fixture(scope="module")
def runs():
    """Angles of drum and joint, torque of the drum and tensions, without friction and with it."""
    return {friction: EXAMPLE["loop"](friction, periods=2) for friction in (0.0, 0.15)}


def test_without_friction_the_drums_work_is_what_the_joints_damping_takes(runs):
    rows = runs[0.0]
    speed = np.gradient(rows[:, 1], TIMESTEP_S)
    damped = DAMPING * float(np.sum(speed**2)) * TIMESTEP_S
    assert EXAMPLE["lost"](rows) == pytest.approx(damped, rel=0.05)
    assert np.allclose(rows[:, 3], rows[:, -1], rtol=1e-9)


def test_with_friction_the_tensions_differ_by_the_capstan_ratio_in_both_directions(runs):
    rows = runs[0.15]
    ratio = rows[:, 3] / rows[:, -1]
    wrap = np.log(ratio.max()) / 0.15
    assert 0.7 < wrap < 1.1  # the tendon turns by about 50 degrees on its guide
    assert ratio.min() == pytest.approx(1.0 / ratio.max(), rel=0.03)
    assert EXAMPLE["lost"](rows) > 5.0 * EXAMPLE["lost"](runs[0.0])
