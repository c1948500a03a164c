"""The model's own error for the robot file that ``identify`` writes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.evaluation.channels import BagComparison
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.identification.fit import Identification
from cdrj_ros.identification.residual_statistics import model_error
from cdrj_ros.model.prepared import Model
from cdrj_ros.recordings import Topics

Vector = NDArray[np.float64]

KINDS: Final = ("effort/", "tension/")
"""Channels for which a robot file can state the model's error."""


def fit_errors(found: Identification) -> dict[str, float]:
    """Errors of the model by channel [N] or [N m], as far as the fitted recordings show them."""
    return {
        name: left.error
        for name, left in found.unexplained.items()
        if left.error > 0.0 and name.startswith(KINDS)
    }


def model_errors(
    model: Model, unseen: Sequence[BagComparison], topics: Topics, channels: Sequence[str]
) -> dict[str, float]:
    """Errors of the model by channel [N] or [N m], without channels that the numbers explain.

    Args:
        model: the fitted robot, with the standard deviations of its numbers alone.
        unseen: comparisons of bags with estimates that were not fitted to them.
        topics: topics of the bags.
        channels: the references that were fitted.
    """
    residuals: dict[str, list[Vector]] = {}
    stddevs: dict[str, list[Vector]] = {}
    for one in unseen:
        again = validate_bag(model, one.path, topics, spread=True)
        stddev = {channel.name: channel.stddev for channel in again.channels}
        for channel in one.channels:
            own = stddev.get(channel.name)
            if own is not None and own.size == channel.estimate.size:
                residual = channel.estimate - channel.reference
                residuals.setdefault(channel.name, []).append(residual)
                stddevs.setdefault(channel.name, []).append(own)
    errors = {
        name: model_error(residuals[name], stddevs[name])
        for name in channels
        if name in residuals and name.startswith(KINDS)
    }
    return {name: error for name, error in errors.items() if error > 0.0}
