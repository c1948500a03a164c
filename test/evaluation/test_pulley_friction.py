"""Friction at the pulleys."""

from __future__ import annotations

import numpy as np
import pytest
from support.places import ROBOT

from cdrj_ros.evaluation.channels import FrictionSums
from cdrj_ros.model.loading import load_model


def test_shares_are_of_the_larger_tension() -> None:
    layout = load_model(ROBOT).layout
    n, elements = 200, len(layout.elements)
    tension = np.full((n, elements), 10.0)
    tension[:, layout.elements.index("upper/4")] = 8.0
    tension[:100, layout.elements.index("lower/1")] = 0.0
    tension[:100, layout.elements.index("lower/2")] = 0.0
    place = {name: k for k, name in enumerate(layout.elements)}
    after = [place[name] for name in layout.pulleys]
    friction = tension[:, after] - tension[:, [k - 1 for k in after]]
    values = np.zeros((n, layout.size))
    values[:, layout.tension], values[:, layout.friction] = tension, friction
    sums = FrictionSums(layout)
    for part in (slice(0, 70), slice(70, n)):
        sums.add(values[part])
    found = {one.name: one for one in sums.result()}
    assert list(found) == list(layout.pulleys)
    for name in ("upper/4", "upper/5"):
        assert found[name].mean == pytest.approx(2.0)
        assert found[name].mean_share == pytest.approx(0.2)
    assert found["upper/3"].largest_share == 0.0
    # samples of a slack cable do not count in the mean
    assert found["lower/2"].mean_share == 0.0
    # half of the time one side is slack, with share 1, and then the share is 0
    assert found["lower/3"].mean_share == pytest.approx(0.5)
