"""Contact cells reproduce Grashof's arcs."""

from __future__ import annotations

from math import degrees, exp, log, pi

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import Estimates, Samples, initial_state, run
from cdrj_ros.model.packing import state_views
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.assembly import divide_contacts

EPOCH_NS = 1_700_000_000_000_000_000
CELLS, MU, PRELOAD = 90, 0.15, 30.0


def half_turn(law: str) -> Robot:
    """A winch, one pulley with half a turn of cable, an anchor."""
    return parse_robot(f"""
        name: half_turn
        motors: [{{name: m}}]
        joints: []
        friction: {{law: {law}, mu_c: {MU}, bristle_stiffness: 1e9}}
        cables:
          - name: c
            axial_stiffness: 6283
            preload: {PRELOAD}
            nodes:
              - {{type: winch, motor: m, winding: 1, radius: 0.015}}
              - {{type: pulley, radius: 0.01, wrap_angle_deg: 180}}
              - {{type: anchor}}
            spans: [0.2, 0.2]
        """)


def wound(model: Model, angle: np.ndarray) -> Estimates:
    samples = Samples(
        EPOCH_NS + np.arange(angle.size) * 1_000_000, angle[:, None], np.empty((angle.size, 0))
    )
    return run(model, initial_state(model), samples)[1]


def segments(model: Model, angle: np.ndarray) -> np.ndarray:
    """Tensions of all segments at the end of a motion [N]; the cable is linear."""
    samples = Samples(
        EPOCH_NS + np.arange(angle.size) * 1_000_000, angle[:, None], np.empty((angle.size, 0))
    )
    views = state_views(model.sizes, run(model, initial_state(model), samples)[0].values)
    stretch = np.asarray(views.length / views.material)
    return model.robot.cables[0].axial_stiffness * np.maximum(stretch - 1.0, 0.0)


@pytest.mark.parametrize("law", ["euler", "elastoplastic"])
def test_grashofs_sliding_arc_forms_by_itself(law: str) -> None:
    # winding in pulls the first element; cells near the winch slide, those behind them hold
    fine = prepare(divide_contacts(half_turn(law), CELLS))
    estimates = wound(fine, np.linspace(0.0, 0.03, 6001))
    tension = estimates.values[:, fine.layout.tension]
    ratio = tension[:, 0] / tension[:, -1]
    at = int(np.searchsorted(ratio, 1.2))
    assert ratio[at] == pytest.approx(1.2, abs=1e-3)
    inside = segments(fine, np.linspace(0.0, 0.03, 6001)[: at + 1])
    pull, hold = inside[:-1], inside[1:]
    bound = (1.0 - exp(-MU * pi / CELLS)) * pull
    sliding = np.abs(pull - hold) >= 0.999 * bound
    arc = 180.0 * np.count_nonzero(sliding) / CELLS
    assert degrees(log(1.2) / MU) == pytest.approx(69.6, abs=0.05)
    assert arc == pytest.approx(69.6, abs=2 * 180.0 / CELLS)
    assert np.all(sliding[: np.count_nonzero(sliding)]), "one arc, at the pulling side"
    # the adhesion arc still has its initial tension
    np.testing.assert_allclose(hold[np.count_nonzero(sliding) + 10 :], PRELOAD, rtol=2e-3)
