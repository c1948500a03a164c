"""Contact cells reproduce Grashof's arcs, and take cable as it is laid on."""

from math import degrees, exp, log, pi

import numpy as np
import pytest
from support.state import state_views

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.simulation.assembly import divide_contacts, make_rig
from cdrj_ros.simulation.truth import simulate

EPOCH_NS = 1_700_000_000_000_000_000
CELLS, MU, PRELOAD = 90, 0.15, 30.0


def half_turn(law):
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


def wound(model, angle):
    samples = Samples(
        EPOCH_NS + np.arange(angle.size) * 1_000_000, angle[:, None], np.empty((angle.size, 0))
    )
    return run(model, initial_state(model), samples)[1]


def segments(model, angle):
    """Tensions of all segments at the end of a motion [N]; the cable is linear."""
    samples = Samples(
        EPOCH_NS + np.arange(angle.size) * 1_000_000, angle[:, None], np.empty((angle.size, 0))
    )
    views = state_views(model.sizes, run(model, initial_state(model), samples)[0].values)
    stretch = np.asarray(views.length / views.material)
    return model.robot.cables[0].axial_stiffness * np.maximum(stretch - 1.0, 0.0)


@pytest.mark.parametrize("law", ["euler", "elastoplastic"])
def test_grashofs_sliding_arc_forms_by_itself(law):
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


CRANK = """
name: crank
motors: [{{name: m}}]
joints:
  - {{name: turn, range: [0.4, 2.2], reference_angle: {0}}}
  - {{name: out, range: [-0.05, 0.05], reference_angle: {1}}}
frames:
  - {{name: arm, motion: revolute, joint: turn, axis: [0, 0, 1]}}
  - {{name: slide, parent: arm, motion: prismatic, joint: out, axis: [1, 0, 0]}}
friction: {{mu_c: 0.2, rho: 1}}
cables:
  - name: c
    axial_stiffness: 6000
    preload: 50
    nodes:
      - {{type: winch, motor: m, winding: 1, radius: 0.01, position: [-0.2, -0.03, 0], turn: ccw,
         axis: [0, 0, 1]}}
      - {{type: cylinder, radius: 0.02, position: [0, 0, 0], axis: [0, 0, 1], turn: ccw}}
      - {{type: anchor, frame: slide, position: [0.1, 0, {rise}]}}
"""


@pytest.mark.parametrize("rise", [0.0, 0.03])
@pytest.mark.parametrize("cells", [2, 8, 31])
def test_cable_that_is_laid_on_and_taken_off_along_an_involute_keeps_its_tension(cells, rise):
    """In a plane, and along a helix."""
    time = np.arange(4001) * 1e-3
    angle = -0.6 + 0.5 * (1.0 - np.cos(pi * time))
    span = 0.1 - 0.02 * (angle - angle[0])
    x = 0.02 * np.cos(angle) - span * np.sin(angle)
    y = 0.02 * np.sin(angle) + span * np.cos(angle)
    joints = np.stack([np.arctan2(y, x), np.hypot(x, y) - 0.1], axis=-1)
    rig = make_rig(parse_robot(CRANK.format(*joints[0].tolist(), rise=rise)), cells)
    assert rig.fine.sizes.surfaces == 1
    still = np.zeros((time.size, 1))
    truth = simulate(rig.lumped.robot, time, joints, motor_angle=still, cells=cells)
    np.testing.assert_allclose(truth.tension, 50.0, rtol=0.0, atol=1e-6)
