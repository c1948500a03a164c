"""All tensions of a cable from a known one: equal to the truth where the cable slips, intervals
where it may be stuck."""

from math import pi

import numpy as np
import pytest
from support.places import PROTOTYPE

from cdrj_ros.estimation.estimator import Samples, initial_state, run
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import load_robot
from examples.paper.propagation import KnownTension, path_of, propagate

EPOCH_NS = 1_700_000_000_000_000_000
STEP_NS = 2_000_000


@pytest.fixture(scope="module")
def swept():
    """A joint that moves back and forth with its winch, after a rest."""
    model = prepare(load_robot(PROTOTYPE))
    moving = np.maximum(np.arange(6000) * STEP_NS * 1e-9 - 1.0, 0.0)
    joint = 0.6 * np.sin(2.0 * pi * 0.2 * moving)
    motor = 8.0 * np.sin(joint) + 0.15 * np.sin(2.0 * pi * 0.2 * moving)
    stamps = EPOCH_NS + np.arange(joint.size) * STEP_NS
    samples = Samples(stamps, motor[:, None].copy(), joint[:, None].copy())
    return model, samples, run(model, initial_state(model), samples)[1]


@pytest.mark.parametrize("element", ["upper/8", "upper/1", "upper/4", "lower/6"])
def test_any_element_gives_all_the_others_where_every_pulley_slides_and_bounds_elsewhere(
    swept, element
):
    model, samples, estimates = swept
    layout = model.layout
    tension = estimates.values[:, layout.tension]
    path = path_of(model, samples.stamp_ns, samples.joint_angle)
    known = tension[:, layout.elements.index(element)]
    result = propagate(model, path, KnownTension(element, known, 1e-4))
    true = tension[:, [layout.elements.index(name) for name in result.elements]]
    pulleys = [layout.pulleys.index(name) for name in result.pulleys]
    force = estimates.values[:, layout.magnitude][:, pulleys]
    sliding = (result.sliding != 0).all(axis=1)
    assert sliding.mean() > 0.1
    assert np.ptp(true[sliding] / true[sliding][:, :1], axis=0).max() > 0.2, "both directions"
    off = (np.abs(result.tension - true) / (true + 1.0))[sliding]
    assert np.percentile(off, 99) < 1e-3
    assert off.max() < 2e-3, "elasticity's share of the slip speed"
    off = (np.abs(result.nodal_force - force) / (force + 1.0))[sliding]
    assert np.percentile(off, 99) < 2e-3
    inside = (true >= result.lower * 0.998 - 0.01) & (true <= result.upper * 1.002 + 0.01)
    assert inside.mean() > 0.9998
    stuck = (result.sliding == 0).all(axis=1)
    width = (result.upper - result.lower).max(axis=1)
    assert np.all(width[stuck] >= 0.1 * known[stuck]), "a stuck cable leaves much open"
    assert np.all(width[sliding] < 1e-9)
