"""Conversion of the spatial tendons of a compiled MuJoCo model to the cables of a robot file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import named_once, printable, said_once
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.mjcf_bodies import Bodies, numbers_of
from cdrj_ros.robot.mjcf_drives import (
    other_actuators,
    other_constraints,
    other_properties,
    rest_length_of,
    stiffness_of,
    tendon_actuators,
)

STIFFNESS: Final = 10_000.0
"""Assumed EA of a tendon without stiffness [N]."""

PRELOAD: Final = 10.0
"""Assumed preload [N]."""

DRUM: Final = 0.01
"""Assumed radius of the drums [m]."""


@dataclass(frozen=True)
class Imported:
    """A robot file's document, and remarks on the conversion."""

    document: Document
    remarks: list[str]
    """Parts of the model that the robot file does not contain, one line each."""


def convert(
    mujoco: ModuleType, model: Any, name: str, tendons: Sequence[str] | None = None
) -> Imported:
    """Convert the spatial tendons of a compiled model.

    Args:
        mujoco: the package.
        model: its ``MjModel``.
        name: of the robot, and of the model in messages.
        tendons: names of those that become cables; None for all.

    Raises:
        UsageError: none of the tendons can be represented.
    """
    return _Import(mujoco, model, name).run(tendons)


class _Import:
    """One model being imported."""

    def __init__(self, mujoco: ModuleType, model: Any, title: str) -> None:
        self._mujoco, self._model, self._title = mujoco, model, title
        self._bodies = Bodies(mujoco, model)
        self._remarks, self._assumed = self._bodies.remarks, self._bodies.assumed
        self._label, self._name = self._bodies.label, self._bodies.name
        self._actuators = tendon_actuators(model, mujoco)
        self._motors: dict[int, str] = {}
        """Names of motors by the tendon that they pull."""

    def run(self, wanted: Sequence[str] | None) -> Imported:
        """Convert all wanted tendons; remarks name those that cannot be represented."""
        cables: list[Document] = []
        for tendon in self._tendons(wanted):
            for name, path, divisor in self._branches(tendon):
                nodes = self._nodes(name, path)
                if nodes is None:
                    continue
                motor = self._motor(tendon, name)
                begin: Document = {"type": "anchor"}
                if motor:
                    begin = {"type": "winch", "motor": motor, "winding": 1, "radius": DRUM}
                    drum = f"cables.{name}.nodes.1"
                    self._assumed += [f"{drum}.radius", f"{drum}.winding"]
                nodes[0] = {**begin, **nodes[0]}
                nodes[-1] = {"type": "anchor", **nodes[-1]}
                cables.append(self._cable(tendon, name, nodes, passive=not motor))
                if divisor != 1.0:
                    self._remarks.append(
                        f"{name}: MuJoCo divides the length of this branch by {divisor:g}; here "
                        "every branch is a cable of its own, at its full length and tension"
                    )
        if not cables:
            raise UsageError(
                f"{printable(self._title)} has no spatial tendon that can become a cable"
                + "".join(f"; {remark}" for remark in said_once(self._remarks))
            )
        document = {
            "name": self._name(Path(self._title).stem),
            "motors": [{"name": name} for name in dict.fromkeys(self._motors.values())],
            "joints": self._bodies.joints(),
            "frames": self._bodies.frames,
            "friction": {"mu_c": 0.1},
            "cables": cables,
            "assumed": self._assumed,
        }
        self._remark_on_the_rest()
        return Imported(document, self._remarks)

    def _tendons(self, wanted: Sequence[str] | None) -> list[int]:
        names = [self._label("TENDON", k) for k in range(self._model.ntendon)]
        for name in wanted or ():
            if name not in names:
                raise UsageError(
                    f"there is no tendon {printable(name)}; the model has "
                    f"{', '.join(map(printable, names)) or 'none'}"
                )
        return [k for k, name in enumerate(names) if not wanted or name in wanted]

    def _branches(self, tendon: int) -> list[tuple[str, list[tuple[int, int, float]], float]]:
        """Name, path and divisor of every branch of a spatial tendon; empty for a fixed tendon."""
        model, kinds = self._model, self._mujoco.mjtWrap
        first = int(model.tendon_adr[tendon])
        steps = range(first, first + int(model.tendon_num[tendon]))
        label = self._label("TENDON", tendon)
        paths: list[tuple[list[tuple[int, int, float]], float]] = [([], 1.0)]
        for k in steps:
            kind, target = int(model.wrap_type[k]), int(model.wrap_objid[k])
            if kind == kinds.mjWRAP_JOINT:
                self._remarks.append(f"{label} is a fixed tendon: a sum of joints without a path")
                return []
            if kind == kinds.mjWRAP_PULLEY:
                paths.append(([], float(model.wrap_prm[k])))
            else:
                paths[-1][0].append((kind, target, float(model.wrap_prm[k])))
        paths = [(path, divisor) for path, divisor in paths if len(path) > 1]
        if len(paths) == 1:
            return [(self._name(label), *paths[0])]
        return [(self._name(f"{label}_{k + 1}"), *path) for k, path in enumerate(paths)]

    def _nodes(self, name: str, path: list[tuple[int, int, float]]) -> list[Document] | None:
        """Nodes of a branch, the ends without their types; None if one cannot be represented."""
        kinds = self._mujoco.mjtWrap
        nodes: list[Document] = []
        point = None
        for kind, target, parameter in path:
            if kind == kinds.mjWRAP_SITE:
                body = int(self._model.site_bodyid[target])
                place = self._bodies.point(name, body, self._model.site_pos[target])
                node = None if place is None else {"type": "eyelet", **place}
            else:
                node = self._body(name, kind == kinds.mjWRAP_CYLINDER, target, round(parameter))
            if node is None:
                return None
            if node == point:
                self._remarks.append(
                    f"{name} returns to a site at once: the loop in between is left out"
                )
                while nodes[-1] != node:
                    nodes.pop()
            else:
                nodes.append(node)
            point = node if node["type"] == "eyelet" else point
        if len(nodes) < 2:
            return None
        for end in (nodes[0], nodes[-1]):
            del end["type"]
        return nodes

    def _body(self, name: str, round_bar: bool, geom: int, side: int) -> Document | None:
        """Node of a wrapping cylinder or sphere; None if it cannot be represented."""
        model, label = self._model, self._label("GEOM", geom)
        body = int(model.geom_bodyid[geom])
        point = self._bodies.point(name, body, model.geom_pos[geom])
        if point is None:
            return None
        radius = float(model.geom_size[geom][0])
        kind = "cylinder" if round_bar else "sphere"
        node = {"type": kind, "radius": radius, **point, "ignored_inside": True}
        if round_bar:
            turned = np.empty(3)
            self._mujoco.mju_rotVecQuat(turned, np.array([0.0, 0.0, 1.0]), model.geom_quat[geom])
            node["axis"] = numbers_of(turned)
        if side < 0:
            return node
        carrier = int(model.site_bodyid[side])
        if carrier != body:
            if not self._bodies.carry(name, carrier):
                return None
            self._remarks.append(
                f"{name} passes outside {label} on the side of {self._label('SITE', side)} of "
                "another body, also in poses in which MuJoCo lets it through the inside since "
                "that site lies there"
            )
            node["side_frame"] = self._bodies.places[carrier][0]
        elif np.linalg.norm(model.site_pos[side] - model.geom_pos[geom]) < radius:
            node["inside"] = True
            return node
        node["side"] = numbers_of(model.site_pos[side] + self._bodies.places[carrier][1])
        return node

    def _motor(self, tendon: int, name: str) -> str:
        """Name of the motor that pulls a tendon; empty for a passive cable."""
        if tendon not in self._motors:
            actuators = self._actuators.get(tendon, [])
            if actuators:
                names = [self._label("ACTUATOR", one) for one in actuators]
                self._motors[tendon] = self._name(names[0], self._bodies.axes)
                gear = float(self._model.actuator_gear[actuators[0], 0])
                if gear != 1.0:
                    self._remarks.append(
                        f"{name}: the gear {gear:g} of its actuator is not carried over: the "
                        "radius of its drum is assumed"
                    )
                if (
                    self._model.actuator_gaintype[actuators[0]]
                    == self._mujoco.mjtGain.mjGAIN_MUSCLE
                ):
                    self._remarks.append(f"{name}: its muscle is a motor with a drum here")
                if names[1:]:
                    self._remarks.append(
                        f"{name} is pulled by {', '.join(names)}: the first one turns its drum"
                    )
            elif self._model.nu or rest_length_of(self._model, tendon) > 0.0:
                return ""
            else:
                self._motors[tendon] = self._name(f"{name}_motor", self._bodies.axes)
                self._remarks.append(
                    f"{name}: its motor is assumed, for the model has no actuators"
                )
        return self._motors[tendon]

    def _cable(self, tendon: int, name: str, nodes: list[Document], *, passive: bool) -> Document:
        stiffness, rest = stiffness_of(self._model, tendon), rest_length_of(self._model, tendon)
        cable: Document = {"name": name, "axial_stiffness": STIFFNESS}
        if passive and stiffness > 0.0 and rest > 0.0:
            cable["axial_stiffness"] = stiffness * rest
            self._remarks.append(
                f"{name} is a passive cable: EA is its stiffness {stiffness:g} N/m times its "
                f"length without tension, {rest:g} m; it is slack below, and not damped"
            )
        else:
            self._assumed.append(f"cables.{name}.axial_stiffness")
            if stiffness > 0.0:
                self._remarks.append(
                    f"the stiffness {stiffness:g} N/m of {name} is that of a spring and not of its "
                    "cable: it is not carried over"
                )
            elif passive and rest > 0.0:
                self._remarks.append(
                    f"{name} is a passive cable, slack up to its limit of {rest:g} m; EA is assumed"
                )
            elif passive:
                self._remarks.append(
                    f"{name} has no actuator, spring or limit and pulls nothing in the model; here "
                    "it is a passive cable, whose EA and preload are assumed"
                )
        if passive and rest > 0.0:
            cable["rest_length"] = rest
        else:
            if not passive and self._model.tendon_limited[tendon]:
                self._remarks.append(f"{name} has a limited length, which is not carried over")
            cable["preload"] = PRELOAD
            self._assumed.append(f"cables.{name}.preload")
        cable["nodes"] = nodes
        return cable

    def _remark_on_the_rest(self) -> None:
        of_model = self._model, self._mujoco, self._label
        moving = self._bodies.moving()
        self._remarks += self._bodies.renamed()
        others = (*other_constraints(*of_model), *other_actuators(*of_model, moving))
        self._remarks += named_once((name, f" {remark}") for name, remark in others)
        self._remarks += other_properties(*of_model, moving)
