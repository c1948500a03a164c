"""The solution of one cable by the core, for structured arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdrj_ros import _core
from cdrj_ros.model.elasticity import Elasticity


def as_numbers(rows: Any) -> Any:
    """Rows of a record as plain numbers, shape (rows, fields); a view."""
    return rows.view(np.float64).reshape(len(rows), -1)


def cable(
    elastic: Elasticity,
    segments: Any,
    contacts: Any,
    first_flux: float,
    last_flux: float,
    law: _core.Law,
    dt: float,
) -> _core.Cable:
    """One cable in one sample, which changes the arrays."""
    return _core.Cable(
        elastic, law, as_numbers(segments), as_numbers(contacts), first_flux, last_flux, dt
    )


def solve_cable(*arguments: Any) -> tuple[int, float]:
    """Advance ``cable`` by the sample; Newton iterations and remaining imbalance [N]."""
    return cable(*arguments).solve()
