"""Other numbers for a robot at run time: reference pose, preloads, and any number of its file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from cdrj_ros.conditioning.samples import Sample
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.robot.document import LARGEST, document_complaints
from cdrj_ros.robot.parameters import allowed_range, find_number, with_numbers
from cdrj_ros.robot.reader import build_robot


class Change(NamedTuple):
    """New numbers of a robot file."""

    values: dict[str, float]
    """By path [SI]."""
    words: str
    """A description."""


def reference_at(model: Model, sample: Sample) -> Change:
    """The change that makes the angles of a sample the reference pose."""
    values, words = {}, []
    for kind, names, angles in (
        ("motor", model.layout.motors, sample.motor_angle),
        ("joint", model.layout.joints, sample.joint_angle),
    ):
        for name, angle in zip(names, angles, strict=True):
            values[f"{kind}s.{name}.reference_angle"] = float(angle)
            words.append(f"{kind} {name} {angle + 0.0:.6g} rad")
    preloads = ", ".join(f"{c.name} {c.preload:g} N" for c in model.robot.cables)
    return Change(values, f"reference is now {', '.join(words)}; there the preloads are {preloads}")


def preloads_of(model: Model, preloads: Mapping[str, float]) -> Change:
    """The change that sets preloads of cables in the reference pose [N], by name.

    Raises:
        UsageError: an unknown cable or a tension out of range.
    """
    known = {cable.name: cable.preload for cable in model.robot.cables}
    if not preloads:
        raise UsageError(f"name at least one cable of {', '.join(known)}")
    for name, value in preloads.items():
        if name not in known:
            raise UsageError(f"there is no cable {name!r}; there are {', '.join(known)}")
        if not 0.0 <= value < 1e6:
            raise UsageError(f"preload of {name} must be in [0, 1e6) N, got {value:g}")
    return Change(
        {f"cables.{name}.preload": value for name, value in preloads.items()},
        "; ".join(f"{n}: {known[n]:g} N, now {v:g} N" for n, v in preloads.items()),
    )


def with_other_numbers(model: Model, values: Mapping[str, float]) -> Model:
    """The robot with some numbers of its file replaced, by path [SI].

    Raises:
        UsageError, RobotFileError: a value is invalid.
    """
    document = with_numbers(dict(model.robot.document), values)
    for path, value in values.items():
        if not abs(value) <= LARGEST:
            raise UsageError(f"{path} must be a finite number, got {value:g}")
    if not all(
        value in allowed_range(find_number(document, path).rules) for path, value in values.items()
    ):
        for complaint in document_complaints(document):
            raise UsageError(complaint)
    # friction leaves the geometry as it was when it was checked
    geometry = any("friction." not in path for path in values)
    return prepare(build_robot(document, model.robot.source), check_range=geometry)
