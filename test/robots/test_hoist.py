"""The hoist compared with the textbook block and tackle.

While the rope is hauled in, the tension of each fall is 1/eta times that of the next one.  Raising
a load W on n falls behind a lead sheave takes a pull of W / (eta + eta^2 + ... + eta^n) at the
winch.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cdrj_ros.model.prepared import Model

WEIGHT = 500.0
FALLS = 4
DRUM = 0.080


def sheave_efficiency(radius: float, bearing_diameter: float, f_d: float) -> float:
    """eta of a sheave that a rope wraps by half a turn: the bearing carries both tensions.

    From the balance of moments (T1 - T2) r = f_d d (T1 + T2).
    """
    return (radius - f_d * bearing_diameter) / (radius + f_d * bearing_diameter)


ETA = sheave_efficiency(0.030, 0.012, 0.05)


@pytest.fixture(scope="module")
def lift(
    models: dict[str, Model], balance: Callable[..., tuple[np.ndarray, np.ndarray]], path: Callable
) -> dict[str, np.ndarray]:
    """Lift the load, raise it by 50 mm and lower it again; the rope always carries the weight."""
    model = models["hoist"]
    height = path(0.4, 0.0, 0.0, 0.05, 0.0)
    force = np.full(height.size, WEIGHT)
    ramp = 100
    force[:ramp] = WEIGHT * np.arange(ramp) / ramp  # the rope tightens while the load rests
    motor, values = balance(model, height, force)
    assert np.all(values[ramp:, model.layout.status] == 0)
    third = (height.size - 1) // 3
    return {
        "motor": motor,
        "height": height,
        "tension": values[:, model.layout.tension],
        "force": values[:, model.layout.joint_effort][:, 0],
        "torque": -values[:, model.layout.motor_effort][:, 0],  # the rope unwinds the drum
        "raising": np.arange(third + 50, 2 * third - 10),
        "lowering": np.arange(2 * third + 50, 3 * third - 10),
    }


def test_the_falls_carry_the_load(lift: dict[str, np.ndarray]) -> None:
    falls = lift["tension"][100:, 1:].sum(axis=1)
    np.testing.assert_allclose(falls, WEIGHT, rtol=1e-6)
    np.testing.assert_allclose(lift["force"][100:], WEIGHT, rtol=1e-6)


@pytest.mark.parametrize(("phase", "exponent"), [("raising", 1.0), ("lowering", -1.0)])
def test_where_all_sheaves_slip_neighbouring_tensions_differ_by_the_efficiency(
    phase: str, exponent: float, lift: dict[str, np.ndarray]
) -> None:
    tension = lift["tension"][lift[phase]]
    ratio = tension[:, 1:] / tension[:, :-1]
    np.testing.assert_allclose(ratio, ETA**exponent, rtol=1e-6)


@pytest.mark.parametrize(("phase", "exponent"), [("raising", 1), ("lowering", -1)])
def test_the_pull_at_the_winch_is_that_of_the_textbook(
    phase: str, exponent: int, lift: dict[str, np.ndarray]
) -> None:
    closed_form = WEIGHT / sum(ETA ** (exponent * k) for k in range(1, FALLS + 1))
    np.testing.assert_allclose(lift["tension"][lift[phase], 0], closed_form, rtol=1e-6)
    np.testing.assert_allclose(lift["torque"][lift[phase]], closed_form * DRUM, rtol=1e-6)
    # 138 N to raise, 113 N to lower; 125 N without friction
    assert (closed_form > WEIGHT / FALLS) == (phase == "raising")


def test_a_rope_without_load_is_slack_and_has_no_tension(models: dict[str, Model]) -> None:
    from cdrj_ros.estimation.estimator import initial_state, step
    from cdrj_ros.estimation.samples import Sample
    from cdrj_ros.model.state import SLACK

    model = models["hoist"]
    payed_out = Sample(1, np.array([-0.1]), np.array([0.0]))
    _, estimate = step(model, initial_state(model), payed_out)
    assert np.all(estimate.tension == 0.0)
    assert np.all(estimate.status.astype(int) & SLACK)
