"""Reported outputs of a sample: forces on pulleys and their status."""

from __future__ import annotations

import numpy as np
from support.places import PROTOTYPE

from cdrj_ros.model.prepared import prepare
from cdrj_ros.model.state import INVALID, OVERLOAD, SLACK
from cdrj_ros.robot.reader import load_robot


def test_a_pulley_has_the_flags_of_both_of_its_elements() -> None:
    layout = prepare(load_robot(PROTOTYPE)).layout
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
