"""Default standard deviations of numbers whose accuracy a robot file does not state.

A number in a file comes from a drawing, a catalogue, a spring scale or a judgement by eye.  Unless
the block ``uncertainty`` states its standard deviation or contains ``others: exact``, its standard
deviation is the one below.  docs/estimation.md has the same table with reasons.  The estimator, the
fits of ``identify`` and those of ``commission`` all begin with these numbers.  What changes after
the file was written, such as a preload that settles, is added by ``estimation/unknowns.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from math import pi
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.arrays import Vector
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.couplings import drum_radii, is_coupled
from cdrj_ros.robot.description import Uncertainty, friction_law
from cdrj_ros.robot.parameters import Number, find_number, joint_range
from cdrj_ros.robot.space_reader import has_bearing, is_spatial

ZERO_BY_EYE: Final = pi / 180.0
"""Error of the zero of a joint set by eye or against a mark [rad]."""

POSITION_BY_EYE: Final = 1e-3
"""Error of the zero of a prismatic joint set by eye [m]."""

SPRING_SCALE: Final = 0.1
"""Error of a preload that was read on a spring scale and has crept since, as a fraction."""

SPRING_SCALE_NOW: Final = 0.045
"""The same of one that was read just now.

The scale's gain errs in all tensions alike, and as long as the file is used.  So twice this value
must hold for nearly every scale, not for 19 of 20; it is half as large again as what scales within
3 % need.
"""

SCALE_READING: Final = 0.01
"""Part of that error that a reading does not share with all others of the same scale."""

CATALOGUE_STIFFNESS: Final = 0.1
"""Error of EA from a catalogue or from the modulus of steel, as a fraction; it includes the
error of the lengths."""

CALLIPER: Final = 5e-5
"""Error of a radius whose diameter was measured over the wound cable by a calliper [m]."""

OTHER_BEND: Final = 0.5
"""Change of a wrap angle in another pose of an instrument, as a fraction: by 45 of 90 degrees."""

DRAWN_RADIUS: Final = 2.5e-4
"""Error of a drawn radius to the cable's centre line, and of all other drawn dimensions [m]."""

LARGEST_RADIUS_SHARE: Final = 0.03
"""Largest standard deviation of a drawn dimension as a fraction of it."""

REST_SHARE: Final = 0.01
"""Error of the length of a spring or a rope without tension, as a fraction."""

COUPLING_RATIO: Final = 0.03
"""Error of the ratio of a coupling, of two drawn radii or levers, as a fraction."""

TABLE_SHARE: Final = 0.01
"""Error of the changes of a tabulated length over the joint's range, as a fraction."""

FRAME_ANGLE: Final = 0.2 * pi / 180.0
"""Error of a frame's orientation from a drawing [rad]."""

HANDBOOK_FRICTION: Final = 0.2
"""Error of coefficients of friction from a handbook, as a fraction; it includes the error of
the wrap angles."""

UNSTATED_FRICTION: Final = 0.05
"""Standard deviation of the coefficient of friction if the file has none."""

BLEND: Final = 0.1
"""Error of a share rho of sliding friction that was not identified."""

HANDBOOK_REST: Final = 0.3
"""Error of bearing friction, bristle stiffness, Stribeck speed, of the bedding of strands, and of
the springs and bearings of axes, as a fraction."""

SPRING_REST: Final = 0.1
"""Error of the angle at which the spring of an axis is relaxed [rad]."""

DRAG: Final = 0.03
"""Load-independent friction of a pulley whose bearing and seal were not measured, as a fraction of
the cable's preload."""

MOST_UNCERTAIN: Final = 7000
"""Largest number of uncertain numbers: their covariance takes 392 MB."""


Factor = dict[str, float]
"""Standard deviations by path [SI] of numbers that deviate together, signed by direction."""


@dataclass(frozen=True)
class Tolerance:
    """Numbers with a common cause of error."""

    what: str
    """The cause in the file's terms: ``zero of joint elbow``."""
    measure: str
    """Cheapest measurement that at least halves the error."""
    factor: Factor


def default_tolerances(document: Document) -> tuple[Tolerance, ...]:
    """Default standard deviations of all numbers of a robot file."""
    found = [*_joints(document), *_axes(document), *_friction(document, "", document)]
    for cable in document["cables"]:
        found += _cable(document, cable)
    found += [*_drums(document), *_terms(document), *_frames(document)]
    return tuple(one for one in found if any(one.factor.values()))


def complete_uncertainty(
    document: Document, stated: Uncertainty | None, *, exact: bool
) -> Uncertainty | None:
    """The stated standard deviations, followed by the default ones of all other numbers.

    Args:
        document: content of the robot file.
        stated: from the block ``uncertainty``.
        exact: whether the file says that all other numbers are exact.

    Returns:
        None if no number is uncertain.

    Raises:
        RobotFileError: more than ``MOST_UNCERTAIN`` are.
    """
    if exact:
        return stated
    known = stated.parameters if stated is not None else ()
    factors = [_unstated(one.factor, known) for one in default_tolerances(document)]
    factors = [factor for factor in factors if factor]
    paths = list(dict.fromkeys(path for factor in factors for path in factor))
    if not paths:
        return stated
    index = {path: k for k, path in enumerate(paths)}
    size = len(known)
    if size + len(paths) > MOST_UNCERTAIN:
        raise RobotFileError(
            f"the robot has {size + len(paths)} uncertain numbers, at most {MOST_UNCERTAIN} are "
            "kept; declare those that uncertainty does not list exact, by others: exact"
        )
    covariance = np.zeros((size + len(paths), size + len(paths)))
    if stated is not None:
        covariance[:size, :size] = stated.covariance
    # entry by entry, since a product of matrices would start threads for 8 ms
    default = covariance[size:, size:]
    for factor in factors:
        for one, other in product(factor.items(), repeat=2):
            default[index[one[0]], index[other[0]]] += one[1] * other[1]
    return Uncertainty((*known, *paths), covariance, size)


def within_range(document: Document, number: Number, changes: Vector) -> Vector:
    """A number after each of several changes, limited to what the schema allows.

    A change that takes a reference angle out of its joint's range is reversed, then clipped to the
    range.  A change beyond an exclusive bound is not made.

    Args:
        document: content of the robot file.
        number: found in it.
        changes: added to it [SI], shape (n,).
    """
    rules = number.rules
    values = number.value + changes
    values = np.clip(values, rules.get("minimum", -np.inf), rules.get("maximum", np.inf))
    if span := joint_range(document, number.path):
        outside = (values < span[0]) | (values > span[1])
        values = np.clip(np.where(outside, 2.0 * number.value - values, values), *span)
    beyond = (values <= rules.get("exclusiveMinimum", -np.inf)) | (
        values >= rules.get("exclusiveMaximum", np.inf)
    )
    return np.where(beyond, number.value, values)


def _unstated(factor: Factor, known: tuple[str, ...]) -> Factor:
    """A factor without the numbers whose accuracy the file states.

    If the file states one number of a factor, its static coefficients of friction are left out
    too: the static coefficient must not fall below the Coulomb coefficient.
    """
    rest = {path: stddev for path, stddev in factor.items() if path not in known}
    if len(rest) < len(factor):
        rest = {path: stddev for path, stddev in rest.items() if not path.endswith(".mu_s")}
    return rest


def _joints(document: Document) -> Iterator[Tolerance]:
    prismatic = {
        frame.get("joint") for frame in document.get("frames", ()) if frame["motion"] == "prismatic"
    }
    for joint in document.get("joints", ()):
        name = joint["name"]
        stddev = POSITION_BY_EYE if name in prismatic else ZERO_BY_EYE
        if is_coupled(joint):
            yield Tolerance(
                f"zero of the coupling of joint {name}", "measure its angle in the reference pose",
                {f"joints.{name}.offset": stddev},
            )  # fmt: skip
            for leader, share in joint["coupled"].items():
                yield Tolerance(
                    f"share of {leader} in joint {name}", "measure both angles in two poses",
                    {f"joints.{name}.coupled.{leader}": COUPLING_RATIO * abs(share)},
                )  # fmt: skip
            continue
        yield Tolerance(
            f"zero of joint {name}", "call ~/tare in the reference pose",
            {f"joints.{name}.reference_angle": stddev},
        )  # fmt: skip
        if joint.get("measured", True):
            yield Tolerance(
                f"zero of the encoder of joint {name}",
                "read it at a stop of known angle, or identify with motor efforts or a load cell",
                {f"joints.{name}.offset": stddev},
            )  # fmt: skip


def _axes(document: Document) -> Iterator[Tolerance]:
    for kind in ("motors", "joints"):
        for axis in document.get(kind, ()):
            at = f"{kind}.{axis['name']}"
            for key, stddev in (
                ("bearing_torque", HANDBOOK_REST * axis.get("bearing_torque", 0.0)),
                ("spring_stiffness", HANDBOOK_REST * axis.get("spring_stiffness", 0.0)),
                ("spring_rest", SPRING_REST if axis.get("spring_stiffness", 0.0) else 0.0),
            ):
                yield Tolerance(
                    f"{key.replace('_', ' ')} of {axis['name']}",
                    f"fit {at}.{key} to its measured effort without cables",
                    {f"{at}.{key}": stddev},
                )  # fmt: skip


def _friction(
    document: Document, at: str, holder: Mapping[str, Any], name: str = "all pulleys"
) -> Iterator[Tolerance]:
    """Friction numbers that one level of the file gives; at robot level also omitted ones."""
    given: Mapping[str, Any] = holder.get("friction", {})
    path = f"{at}friction."
    yield Tolerance(
        f"friction of {name}", "identify --fit mu_c with a load cell at the far end of a cable",
        {path + key: HANDBOOK_FRICTION * given[key] for key in ("mu_c", "mu_s") if key in given},
    )  # fmt: skip
    if not at and not _has_friction(document):
        yield Tolerance(
            "friction that the file leaves out", "state mu_c, or law: none",
            {path + "mu_c": UNSTATED_FRICTION},
        )  # fmt: skip
    if "rho" in given or (not at and _has_friction(document)):
        yield Tolerance(
            f"share rho of {name}", "identify --fit rho with a load cell at the far end of a cable",
            {path + "rho": BLEND},
        )  # fmt: skip
    for key in ("bearing_friction", "bristle_stiffness", "stribeck_speed"):
        yield Tolerance(
            f"{key.replace('_', ' ')} of {name}", f"identify --fit {key}",
            {path + key: HANDBOOK_REST * given.get(key, 0.0)},
        )  # fmt: skip


def _has_friction(document: Document) -> bool:
    """Whether the file gives a coefficient of friction at any level, or rules friction out."""
    levels = [document, *document["cables"]]
    levels += [node for cable in document["cables"] for node in cable["nodes"]]
    return any(not {"mu_c", "law"}.isdisjoint(level.get("friction", {})) for level in levels) and (
        any("mu_c" in level.get("friction", {}) for level in levels)
        or not any(friction_law(_law(document, cable)).sliding for cable in document["cables"])
    )


def _law(document: Document, cable: Mapping[str, Any]) -> str:
    laws: Mapping[str, str] = {**document.get("friction", {}), **cable.get("friction", {})}
    return laws.get("law", "elastoplastic")


def _cable(document: Document, cable: Mapping[str, Any]) -> Iterator[Tolerance]:
    name, at = cable["name"], f"cables.{cable['name']}"
    preload = float(cable.get("preload", 0.0))
    if "rest_length" in cable:
        yield Tolerance(
            f"rest length of {name}", "unhook one end and measure it with a calliper",
            {f"{at}.rest_length": max(DRAWN_RADIUS, REST_SHARE * cable["rest_length"])},
        )  # fmt: skip
    else:
        yield Tolerance(
            f"preload of {name}", "measure it with a spring scale now and call ~/set_preload",
            {f"{at}.preload": max(SPRING_SCALE * preload, float(cable.get("slack_tension", 0.1)))},
        )  # fmt: skip
    stiffness = find_number(document, f"{at}.axial_stiffness").value
    yield Tolerance(
        f"EA of {name}", "hang two known weights on it, or identify --fit EA with a load cell",
        {f"{at}.axial_stiffness": CATALOGUE_STIFFNESS * stiffness},
    )  # fmt: skip
    for key in ("bedding_strain", "bedding_tension") if cable.get("bedding_strain", 0.0) else ():
        yield Tolerance(
            f"{key.replace('_', ' ')} of {name}",
            "identify --fit bedding_strain,bedding_tension with loads from low to high",
            {f"{at}.{key}": HANDBOOK_REST * float(cable[key])},
        )
    creep = ("creep_share", "creep_time") if cable.get("creep_share") else ()
    for key in (*creep, *(("flow_time",) if "flow_time" in cable else ())):
        yield Tolerance(
            f"{key.replace('_', ' ')} of {name}",
            f"identify --fit {key} with a recording that rests for several times that long",
            {f"{at}.{key}": HANDBOOK_REST * float(cable[key])},
        )
    yield from _friction(document, f"{at}.", cable, f"cable {name}")
    law = _law(document, cable)
    radii: Factor = {}
    drag: Factor = {}
    for k, node in enumerate(cable["nodes"]):
        here = f"{at}.nodes.{k + 1}"
        if node["type"] not in ("winch", "anchor"):
            if "radius" in node:
                radii[f"{here}.radius"] = _drawn(node["radius"])
            if has_bearing(node["type"]) and friction_law(law).bearing:
                torque = float(node.get("bearing_torque", 0.0))
                drag[f"{here}.bearing_torque"] = (
                    DRAG * preload * node["radius"] + HANDBOOK_REST * torque
                )
            yield from _friction(document, f"{here}.", node, f"node {name}/{k + 1}")
        elif node["type"] == "anchor" and node.get("radius"):
            yield Tolerance(
                f"sector of {name}", "measure its diameter over the cable with a calliper",
                {f"{here}.radius": _drawn(node["radius"])},
            )  # fmt: skip
        yield from _position(f"{here}.position", node, f"node {name}/{k + 1}")
    yield Tolerance(
        f"pulley radii of {name}", "measure their diameters over the cable with a calliper", radii
    )
    yield Tolerance(
        f"drag of the pulleys of {name}",
        "pull the slack cable through with a spring scale, or identify --fit pulley_bearing_torque",
        drag,
    )


def _drawn(dimension: float) -> float:
    """Standard deviation of a dimension from a drawing [m]."""
    return min(DRAWN_RADIUS, LARGEST_RADIUS_SHARE * abs(dimension))


def _position(path: str, entry: Mapping[str, Any], name: str) -> Iterator[Tolerance]:
    for k, _ in enumerate(entry.get(path.rsplit(".", 1)[-1], ())):
        yield Tolerance(
            f"position {'xyz'[k]} of {name}", "measure it with a calliper",
            {f"{path}.{k + 1}": DRAWN_RADIUS},
        )  # fmt: skip


def _drums(document: Document) -> Iterator[Tolerance]:
    """Drum radii by motor; the drums of one motor share their error (turned on one lathe)."""
    for motor, radii in drum_radii(document).items():
        yield Tolerance(
            f"drum radius of motor {motor}", "wind in ten turns and measure the cable's length",
            {path: _drawn(radius) for path, radius in radii.items()},
        )  # fmt: skip


def _terms(document: Document) -> Iterator[Tolerance]:
    """Moment arms and tables of spans by joint; the strands over a joint share their error."""
    arms: dict[str, Factor] = {}
    for cable in document["cables"]:
        for k, span in enumerate(cable.get("spans", ())):
            path = f"cables.{cable['name']}.spans.{k + 1}"
            several = isinstance(span, list)
            for t, term in enumerate(span if several else [span]):
                if isinstance(term, dict):
                    at = f"{path}.{t + 1}" if several else path
                    arms.setdefault(term["joint"], {}).update(_term(at, term))
    for joint, factor in arms.items():
        yield Tolerance(
            f"moment arms of joint {joint}", "measure the strands' distances with a calliper",
            factor,
        )  # fmt: skip


def _term(path: str, term: Mapping[str, Any]) -> Factor:
    factor: Factor = {}
    for key in ("slope", "sine"):
        if value := term.get(key, 0.0):
            factor[f"{path}.{key}"] = _drawn(value) * (1.0 if value > 0.0 else -1.0)
    values = term.get("value", ())
    for k, value in enumerate(values):
        change = TABLE_SHARE * (value - values[len(values) // 2])
        if change:
            factor[f"{path}.value.{k + 1}"] = change
    return factor


def _frames(document: Document) -> Iterator[Tolerance]:
    spatial = is_spatial(document)
    for frame in document.get("frames", ()):
        name = frame["name"]
        yield from _position(f"frames.{name}.origin", frame, f"frame {name}")
        if not spatial:
            yield Tolerance(
                f"orientation of frame {name}", "measure it with a protractor",
                {f"frames.{name}.angle": FRAME_ANGLE},
            )  # fmt: skip
        if frame.get("radius"):
            yield Tolerance(
                f"rolling radius of frame {name}", "measure it with a calliper",
                {f"frames.{name}.radius": _drawn(frame["radius"])},
            )  # fmt: skip
