"""Values of a formally valid robot file that are probably wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from math import degrees, isinf, pi
from typing import Any, Final

from cdrj_ros.inspection.motors import encoderless_suspicions
from cdrj_ros.inspection.poses import pose_text
from cdrj_ros.inspection.ranges import CableCheck, Inspection
from cdrj_ros.model.impossible import Suspicion, unit_doubts
from cdrj_ros.model.laws import elasticity_of, modulus_at, strain_at
from cdrj_ros.model.untouched import untouched_bodies
from cdrj_ros.robot.description import (
    Anchor,
    Cable,
    Friction,
    Pulley,
    Robot,
    Winch,
    friction_law,
    turns_of,
)

LARGEST_ARM: Final = 2.0
"""Moment arm about a hinge beyond which millimetres were probably given as metres [m]."""

NARROW_WRAP: Final = 2.0 * pi / 180.0
"""Wrap below which a cable is about to leave its pulley [rad]."""

WRONG_SENSE: Final = 1.5 * pi
"""Wrap beyond which the ``turn`` of a pulley given by its position is probably wrong [rad]."""

SHORTEST_SHARE: Final = 0.1
"""Smallest acceptable ratio of an element's shortest to its longest span [-]."""

MOST_TURNS: Final = 10.0
"""Number of turns of a drum beyond which the cable usually lies in several layers."""

LARGEST_LOSS: Final = 0.5
"""Relative loss of tension beyond which friction errors dominate the estimate [-]."""

LARGEST_STRAIN: Final = 0.03
"""Strain at which cables usually break or yield [-]."""

LEAST_BENDING: Final = 5.0
"""Smallest ratio of pulley or drum diameter to cable diameter [-]; wire ropes need 16 or more."""

LARGEST_DIAMETER: Final = 0.05
"""Largest plausible diameter of a cable [m]."""

PLAUSIBLE_MODULUS: Final = (1e9, 250e9)
"""Plausible range of the cable's effective Young's modulus, from nylon to above steel [Pa]."""

LOST_PRELOAD: Final = 0.05
"""Fraction of the preload below which the preload is reported as lost [-]."""

SMALL_ARM: Final = 1e-3
"""Fraction of a joint's largest moment arm below which a moment arm is treated as zero [-]."""

LARGEST_UNSTATED: Final = 0.01
"""Relative error of the tension beyond a pulley that an unstated moving end may cause without being
reported [-]: the accuracy of a good load cell, below which nobody could notice."""


def find_suspicions(inspection: Inspection) -> tuple[Suspicion, ...]:
    """Find all suspicious properties of a robot, grave ones first."""
    robot = inspection.model.robot
    entries = {entry["name"]: entry for entry in robot.document.get("cables", ())}
    found = [*unit_doubts(robot)]
    if assumed := robot.document.get("assumed"):
        paths = ", ".join(_patterns(robot, assumed))
        text = f"{paths}: guesses; measure them and take them off the list"
        found.append(Suspicion("assumed", text))
    for cable, check in zip(robot.cables, inspection.cables, strict=True):
        entry = entries.get(cable.name, {})
        found += _geometry(robot, cable, check)
        found += _moving_ends(cable, check, entry.get("nodes", ()))
        found += _slip(cable, check)
        found += _friction(cable)
        found += _tension(robot, cable, check)
        found += _material(cable, entry.get("youngs_modulus"))
        found += _thickness(cable, entry.get("diameter"))
    unlimited = [cable.name for cable in robot.cables if isinf(cable.maximum_tension)]
    if unlimited:
        text = "without max_tension: overload is only UNSURE"
        found.append(Suspicion(", ".join(unlimited), text, grave=False))
    found += untouched_bodies(inspection.model)
    found += _motors(inspection)
    found += _joints(inspection)
    found += encoderless_suspicions(inspection.model)
    return tuple(sorted(found, key=lambda suspicion: not suspicion.grave))


def _patterns(robot: Robot, paths: Sequence[str]) -> Iterator[str]:
    """Patterns that match paths: those that differ in the name of an entry alone as one."""
    alike: dict[tuple[str, str], list[str]] = {}
    for path in paths:
        kind, name, *rest = path.split(".", 2)
        alike.setdefault((kind, "".join(f".{key}" for key in rest)), []).append(name)
    every = {"cables": len(robot.cables), "joints": len(robot.joints)}
    for (kind, key), own in alike.items():
        several = "*" if len(own) == every.get(kind) else f"[{','.join(own)}]"
        yield f"{kind}.{several if len(own) > 1 else own[0]}{key}"


def _at(robot: Robot, cable: Cable, pose: tuple[float, ...]) -> str:
    text = pose_text(robot, pose, cable)
    return f" at {text}" if text else ""


def _geometry(robot: Robot, cable: Cable, check: CableCheck) -> Iterator[Suspicion]:
    at = partial(_at, robot, cable)
    for pulley, node in zip(check.pulleys, cable.pulleys, strict=True):
        wrap = pulley.wrap
        if node.kind not in ("pulley", "swivel"):  # the cable may leave it, or go round often
            continue
        if wrap.low < NARROW_WRAP:
            yield Suspicion(
                pulley.name,
                f"the wrap falls to {degrees(wrap.low):.1f}°{at(wrap.low_at)}: the cable "
                "is about to leave the pulley",
            )
        if cable.placed and WRONG_SENSE < wrap.high <= 2.0 * pi:
            yield Suspicion(
                pulley.name,
                f"the wrap grows to {degrees(wrap.high):.0f}°{at(wrap.high_at)}: is turn "
                "the other way round?",
            )
        if wrap.high > 2.0 * pi:
            yield Suspicion(
                pulley.name,
                f"the wrap grows to {degrees(wrap.high):.0f}°{at(wrap.high_at)}: more than "
                "a whole turn, so that the cable crosses itself",
            )
    yield from _arms_and_spans(robot, cable, check)


def _arms_and_spans(robot: Robot, cable: Cable, check: CableCheck) -> Iterator[Suspicion]:
    at = partial(_at, robot, cable)
    for element in check.elements:
        span = element.span
        if span.high > 0.0 and span.low < SHORTEST_SHARE * span.high:
            yield Suspicion(
                element.name,
                f"the free span shrinks to {1e3 * span.low:.1f} mm{at(span.low_at)}, "
                f"{100.0 * span.low / span.high:.0f} % of its longest",
            )
    changing = []
    for joint, arm in zip(robot.joints, check.moment_arm, strict=True):
        size = max(abs(arm.low), abs(arm.high))
        if size > LARGEST_ARM and joint.name not in robot.prismatic_joints:
            yield Suspicion(
                cable.name, f"moves {size:.3g} m per radian of {joint.name}: are all lengths in m?"
            )
        if arm.low < -SMALL_ARM * size and arm.high > SMALL_ARM * size and size > 1e-9:
            changing.append(joint.name)
    if changing:  # normal for the cables of a platform; a dead centre for a single joint
        yield Suspicion(
            cable.name,
            f"the moment arm changes sign about {', '.join(changing)}: the cable pulls one way in "
            "one part of the range and the other way in the rest",
            grave=len(robot.joints) == 1,
        )


def _tension(robot: Robot, cable: Cable, check: CableCheck) -> Iterator[Suspicion]:
    at = partial(_at, robot, cable)
    lost = 1.0 - check.transmission_at_rest.low
    if lost > LARGEST_LOSS:
        yield Suspicion(
            cable.name,
            f"friction may reduce its tension by {100.0 * lost:.0f} %"
            f"{at(check.transmission_at_rest.low_at)}: errors of the friction parameters "
            "will dominate the estimate of the far elements",
        )
    if check.worst.high > cable.maximum_tension:
        yield Suspicion(
            cable.name,
            f"{check.worst.high:.4g} N at the pulling end{at(check.worst.high_at)}, "
            f"friction included, is above max_tension {cable.maximum_tension:g} N",
        )
    if cable.preload == 0.0:
        yield Suspicion(
            cable.name,
            "has no preload: its tension follows from its elongation by the winch",
            grave=False,
        )
    elif check.followed.low < LOST_PRELOAD * cable.preload:
        passive = not any(isinstance(node, Winch) for node in cable.nodes)
        why = (
            "it has no winch"
            if passive
            else "a motor cannot follow all of its cables at once; compare their moment arms, "
            "drum radii and windings"
        )
        yield Suspicion(
            cable.name,
            f"the tension falls from the preload {cable.preload:g} N to {check.followed.low:.3g} N"
            f"{at(check.followed.low_at)} although the motors follow the joints: {why}",
        )


def _material(cable: Cable, modulus: float | None) -> Iterator[Suspicion]:
    least, most = PLAUSIBLE_MODULUS
    if modulus is not None and not least <= modulus <= most:
        yield Suspicion(
            cable.name,
            f"youngs_modulus is {modulus / 1e9:.3g} GPa; steel rope has 50 to 200, braided "
            "polymers 5 to 120: is the unit right?",
        )
    strain = strain_at(elasticity_of(cable), cable.preload)
    if strain > LARGEST_STRAIN and not cable.rest_length:  # a spring with a length of its own
        yield Suspicion(
            cable.name,
            f"the preload alone stretches it by {100.0 * strain:.3g} %: is EA = "
            f"{cable.axial_stiffness:.4g} N right?",
        )


def _thickness(cable: Cable, diameter: float | None) -> Iterator[Suspicion]:
    """Report a cable too thick for its bending radius, for example because of a wrong unit."""
    if diameter is None:
        return
    radii = [node.radius for node in cable.nodes if node.radius > 0.0]
    size = f"{1e3 * diameter:g} mm (a key diameter_mm takes millimetres)"
    if radii and 2.0 * min(radii) < LEAST_BENDING * diameter:
        yield Suspicion(
            cable.name,
            f"diameter is {size}, and it bends around a radius of {1e3 * min(radii):g} mm: "
            f"cables need {LEAST_BENDING:g} times their diameter, usually more; is the unit right?",
        )
    elif diameter > LARGEST_DIAMETER:
        yield Suspicion(cable.name, f"diameter is {size}: is the unit right?")


def _motors(inspection: Inspection) -> Iterator[Suspicion]:
    robot = inspection.model.robot
    for motor, check in zip(robot.motors, inspection.motors, strict=True):
        ends = [
            (cable.name, node, place)
            for cable in robot.cables
            for place, node in ((1, cable.nodes[0]), (-1, cable.nodes[-1]))
            if isinstance(node, Winch) and motor.name in turns_of(node)
        ]
        if not ends:
            yield Suspicion(motor.name, "moves no cable: no winch names this motor")
            continue
        turns = check.angle.width / (2.0 * pi)
        if turns > MOST_TURNS:
            yield Suspicion(
                motor.name,
                f"makes {turns:.1f} turns over the joint range: if the cable lies in several "
                "layers, the drum's radius is not constant",
            )
        senses = {
            name: (turns_of(node)[motor.name] > 0.0) == (node.place.turn * place > 0)
            for name, node, place in ends
            if node.place is not None and robot.planar
        }
        if len(set(senses.values())) > 1:
            yield Suspicion(
                motor.name,
                "winding and turn contradict each other between "
                + " and ".join(senses)
                + ": on drums of one shaft, winding must be equal where cables leave with the same "
                "sense of rotation, and opposite otherwise",
            )
    for kind, axes in (("motors", robot.motors), ("joints", robot.joints)):
        negative = [one.name for one in axes if one.effort_sign < 0]
        if 0 < len(negative) < len(axes):
            yield Suspicion(
                ", ".join(negative),
                f"effort_sign is -1 here and +1 of the other {kind}: these efforts balance the "
                "cables, the others are exerted by the cables",
                grave=False,
            )


def _joints(inspection: Inspection) -> Iterator[Suspicion]:
    robot = inspection.model.robot
    moved = []
    for j, joint in enumerate(robot.joints):
        arms = [check.moment_arm[j] for check in inspection.cables]
        most = max(max(abs(arm.low), abs(arm.high)) for arm in arms)
        if most <= 1e-9:
            yield Suspicion(joint.name, "is not moved by any cable")
            continue
        moved.append(joint.name)
        small = SMALL_ARM * most
        for sign, word in ((1.0, "increase"), (-1.0, "decrease")):
            if all(max(sign * arm.low, sign * arm.high) <= small for arm in arms):
                yield Suspicion(
                    joint.name,
                    f"no cable can {word} it: only a load, gravity or a spring can",
                    grave=False,
                )
    if inspection.unmoved and len(moved) == len(robot.joints):
        yield Suspicion(
            ", ".join(moved),
            f"at {pose_text(robot, inspection.unmoved[0])} the joints can move without changing "
            f"any cable's length (in {len(inspection.unmoved)} of {len(inspection.poses)} poses)",
        )
    for cable in robot.cables:
        if all(isinstance(node, Anchor) for node in (cable.nodes[0], cable.nodes[-1])):
            yield Suspicion(
                cable.name, "has no winch: a passive cable between two anchors", grave=False
            )


def _slip(cable: Cable, check: CableCheck) -> Iterator[Suspicion]:
    for k, pulley in enumerate(check.pulleys):
        if pulley.transmission_at_rest.low >= 1.0 or pulley.passing > max(pulley.needed, 1e-6):
            continue
        bound = (1.0 - pulley.transmission_at_rest.low) * check.followed.high
        yield Suspicion(
            pulley.name,
            f"the joints move {1e6 * pulley.passing:.1f} µm of cable over it"
            + (
                f", {1e6 * pulley.needed:.1f} µm are needed to know its friction"
                if pulley.needed > 0.0
                else ""
            )
            + f": it slips only if the tension changes by about {_swing(cable, check, k, bound)}; "
            f"until then the tensions behind it are only known to ±{bound:.2g} N",
            grave=False,
        )


def _moving_ends(
    cable: Cable, check: CableCheck, nodes: Sequence[Mapping[str, Any]]
) -> Iterator[Suspicion]:
    """Report given wraps that change while the file does not say which end of the arc moves.

    The default is wrong by radius * change / 2 of slip at most.  That slip takes friction towards
    its other bound, which it reaches after ``needed`` with 2 (1 - eta) of the tension.

    ``nodes`` are those of the file, in SI; empty for a robot that was not read from a file.
    """
    for pulley, node, entry in zip(check.pulleys, cable.pulleys, nodes[1:-1], strict=False):
        turned = pulley.wrap.width
        if "wrap_angle" not in entry or "moving_end" in entry or turned == 0.0:
            continue
        slip = 0.5 * node.radius * turned
        share = slip / pulley.needed if slip < pulley.needed else 1.0
        change = share * 2.0 * (1.0 - pulley.transmission_at_rest.low)
        if change > LARGEST_UNSTATED:
            yield Suspicion(
                pulley.name,
                f"the wrap changes by {degrees(turned):.1f}°, but no moving_end says at which end "
                f"of the arc: its slip is only known to ±{1e3 * slip:.2g} mm, and the tension "
                f"beyond it may be wrong by {100.0 * change:.2g} %; give before, after or both",
            )


def _swing(cable: Cable, check: CableCheck, k: int, bound: float) -> str:
    """Change of tension ahead of a pulley that takes its friction from one bound to the other."""
    modulus = modulus_at(elasticity_of(cable), check.followed.high)
    behind = modulus / sum(element.length.high for element in check.elements[k + 1 :])
    contact = cable.pulleys[k].friction.bristle_stiffness
    return f"{2.0 * bound * (1.0 + behind / contact):.2g} N"


def _friction(cable: Cable) -> Iterator[Suspicion]:
    """Report friction keys without effect; pulleys with the same finding are grouped."""
    groups: dict[str, list[str]] = {}
    for name, pulley in zip(cable.pulley_names, cable.pulleys, strict=True):
        for text in _without_effect(cable, pulley):
            groups.setdefault(text, []).append(name)
    for text, names in groups.items():
        alike = len(names) == len(cable.pulleys) and len(names) > 1
        where = cable.name if alike else ", ".join(names)
        yield Suspicion(where, text, grave=not text.startswith("no friction"))


def _without_effect(cable: Cable, pulley: Pulley) -> Iterator[str]:
    friction = pulley.friction
    law = friction_law(cable.law)
    if not law.sliding:
        if friction.mu_c > 0.0 or friction.bearing_friction > 0.0:
            yield f"law is {cable.law}: mu_c and bearing_friction are without effect"
        return
    yield from _static_without_effect(cable, friction)
    bearing = friction.bearing_friction > 0.0 and pulley.bearing_diameter > 0.0
    if bearing and (friction.rho == 1.0 or not law.bearing):
        yield (
            "bearing_friction is without effect: "
            + (
                "rho is 1: sliding friction only"
                if law.bearing
                else f"law {cable.law} has sliding friction only"
            )
        )
    if friction.bearing_friction > 0.0 and pulley.bearing_diameter == 0.0 and friction.rho < 1.0:
        yield "bearing_friction is without effect: bearing_diameter is 0"
    sliding = friction.rho > 0.0 or not law.bearing
    if friction.mu_c > 0.0 and not sliding:
        yield f"mu_c = {friction.mu_c:g} is without effect: rho is 0, only the bearing counts"
    if not (bearing or pulley.bearing_torque > 0.0) and (friction.mu_c == 0.0 or not sliding):
        yield f"no friction at all, although law is {cable.law}"


def _static_without_effect(cable: Cable, friction: Friction) -> Iterator[str]:
    """Report mu_s or stribeck_speed if it has no effect."""
    if friction.mu_s == friction.mu_c:
        if friction.stribeck_speed is not None:
            yield "stribeck_speed is without effect: mu_s equals mu_c"
        return
    reason = ""
    if not friction_law(cable.law).static:
        reason = f"law {cable.law} has no static friction"
    elif friction.rho == 0.0:
        reason = "rho is 0: only the bearing counts"
    elif friction.mu_c == 0.0 and friction.stribeck == "printed":
        reason = "the printed form scales mu_c, which is 0"
    if reason:
        yield f"mu_s = {friction.mu_s:g} is without effect: {reason}"
