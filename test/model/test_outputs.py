"""Reported outputs of a sample: forces on pulleys and their status."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.estimation.estimator import initial_state, run
from cdrj_ros.estimation.samples import Samples
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.model.status import INVALID, OVERLOAD, SLACK
from cdrj_ros.robot.reader import load_robot

ROBOTS = Path(__file__).parents[2] / "config" / "robots"


@pytest.mark.parametrize("name", ["prototype", "prototype_positions"])
def test_components_and_tensions_give_the_same_magnitude(name: str) -> None:
    model = prepare(load_robot(ROBOTS / f"{name}.yaml"))
    layout, size = model.layout, 30
    joint = np.linspace(0.0, 0.02, size)[:, None]
    stamps = 1_000_000_000 + 1_000_000 * np.arange(size)
    motor = np.zeros((size, len(layout.motors)))
    values = run(model, initial_state(model), Samples(stamps, motor, joint))[1].values
    wrap = np.array([shape_at(model, angle).wrap for angle in joint])
    tension = values[:, layout.tension]
    before = tension[:, layout.element_before]
    after = tension[:, layout.element_before + 1]
    force = np.sqrt(before**2 + after**2 - 2.0 * before * after * np.cos(wrap))  # (38)
    assert force.min() > 1.0
    np.testing.assert_allclose(values[:, layout.magnitude], force, rtol=1e-9)


def test_a_pulley_has_the_flags_of_both_of_its_elements() -> None:
    layout = prepare(load_robot(ROBOTS / "prototype.yaml")).layout
    status = np.zeros((3, len(layout.elements)), np.uint8)
    status[0, layout.elements.index("upper/1")] = SLACK
    status[1, layout.elements.index("upper/3")] = OVERLOAD
    status[1, layout.elements.index("upper/4")] = INVALID
    last = [name for name in layout.elements if name.startswith("upper/")][-1]
    status[2, layout.elements.index(last)] = SLACK
    found = [
        {name: int(flag) for name, flag in zip(layout.pulleys, row, strict=True) if flag}
        for row in layout.pulley_status(status)
    ]
    assert found[0] == {"upper/2": SLACK}
    assert found[1] == {
        "upper/3": OVERLOAD, "upper/4": OVERLOAD | INVALID, "upper/5": INVALID,
    }  # fmt: skip
    last_pulley = [name for name in layout.pulleys if name.startswith("upper/")][-1]
    assert found[2] == {last_pulley: SLACK}
    assert layout.pulley_status(status[0]).tolist() == layout.pulley_status(status)[0].tolist()
