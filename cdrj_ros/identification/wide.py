"""Additional unknowns for numbers whose accuracy the robot file does not state.

In a fit of few numbers to few references, errors of all other numbers of the file distort the
result.  Stiffness, preload, drum radius, zeros of the joints and drag of the pulleys are therefore
fitted too, with priors from the tolerances of ``cdrj_ros.robot.tolerances``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.identification.unknowns import Unknown, parse_unknowns
from cdrj_ros.robot.description import Uncertainty
from cdrj_ros.robot.document import Document
from cdrj_ros.robot.parameters import find_number

ALONG: Final = (
    "preload", "EA", "drum_radius", "joints.{*}.reference_angle", "pulley_bearing_torque",
)  # fmt: skip
"""Numbers to fit in addition, in the notation of ``--fit``."""

ALIKE: Final = 1e-9
"""Largest relative difference of numbers that are fitted as one unknown."""


def fitted_along(
    document: Document, known: Uncertainty | None, unknowns: Sequence[Unknown]
) -> tuple[Unknown, ...]:
    """Further unknowns with priors, for numbers whose accuracy the file does not state.

    Args:
        document: content of the robot file.
        known: the robot's uncertainty; numbers that it states or that are exact stay fixed.
        unknowns: those that the user requested.
    """
    if known is None or len(known.parameters) == known.stated:
        return ()
    stddev = dict(zip(known.parameters, np.sqrt(np.diag(known.covariance)).tolist(), strict=True))
    taken = {path for unknown in unknowns for path in unknown.paths}
    taken |= set(known.parameters[: known.stated])
    along: list[Unknown] = []
    for item in ALONG:
        try:
            found = parse_unknowns(document, item)
        except UsageError:  # no joint, or no pulley
            continue
        for one in found:
            spread = [stddev.get(path, 0.0) for path in one.paths]
            values = [find_number(document, path).value for path in one.paths]
            alike = np.ptp(values) <= ALIKE * max(map(abs, values))
            if taken.isdisjoint(one.paths) and min(spread) > 0.0 and alike:
                along.append(replace(one, prior=(one.start, float(np.mean(spread)))))
    return tuple(along)
