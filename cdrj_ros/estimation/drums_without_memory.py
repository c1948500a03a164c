"""Compiled steps of robots whose cables slip on their drums."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.compiled import lean
from cdrj_ros.model.drum import start_drum
from cdrj_ros.model.mechanism import advance_robot
from cdrj_ros.model.packing import number_views, plan_views
from cdrj_ros.model.state import state_views
from cdrj_ros.model.views import copy_part

Vector = NDArray[np.float64]
Table = NDArray[np.float64]


@lean
def forget_drums(plan: NDArray[np.int64], numbers: Vector, state: Vector) -> None:
    """Give all cable on the drums the present strain, as of a cable that slips on its drum."""
    layout = plan_views(plan)
    values, now = number_views(layout.sizes, numbers), state_views(layout.sizes, state)
    for c in range(len(layout.cables)):
        cable = layout.cables[c]
        for end in range(2):
            number = layout.ends[2 * c + end].drum
            if number < 0:
                continue
            e = cable.first_contact + c + (0 if end == 0 else cable.contacts)
            drum = now.drums[number]
            top = int(drum.points) - 1
            rate = values.ends[2 * c + end].radius / max(now.length[e] / now.material[e], 1.0)
            start_drum(drum, drum.angle[top], drum.material[top], rate)


@lean
def advance_slipping(
    plan: NDArray[np.int64],
    numbers: Vector,
    state: Vector,
    motor_angles: Table,
    joint_angles: Table,
    dt: Vector,
    out: Vector,
    estimates: Table,
) -> None:
    """As ``advance_all`` of the model, for a robot whose cables slip on their drums.

    The arguments are those of ``advance_all``, with ``out``, scratch of shape (out_size,).
    """
    for k in range(dt.size):
        solved = advance_robot(plan, numbers, state, motor_angles[k], joint_angles[k], dt[k], out)
        copy_part(out, 0, state)
        copy_part(out, state.size, estimates[k])
        if solved:
            forget_drums(plan, numbers, state)
