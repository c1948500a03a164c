"""Conversion of the spatial tendons of a compiled MuJoCo model to the cables of a robot file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from pathlib import Path
from types import ModuleType
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.foundation.output import printable, said_once
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.mjcf_drives import (
    following_joints,
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

NAMED: Final = 3
"""Number of names that differ from the model's of which a remark tells both."""


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


def _numbers(values: Any) -> list[float]:
    return [float(value) for value in values]


class _Import:
    """One model being imported."""

    def __init__(self, mujoco: ModuleType, model: Any, title: str) -> None:
        self._mujoco, self._model, self._title = mujoco, model, title
        self._remarks: list[str] = []
        self._renamed: dict[str, str] = {}
        """What is said of names that differ from the model's, by name."""
        self._frames: list[Document] = []
        self._bodies: dict[int, tuple[str, Any]] = {0: ("base", np.zeros(3))}
        """Frame of every body, and the body's origin in it [m]."""
        self._joints: list[int] = []
        self._following = following_joints(model, mujoco)
        self._actuators = tendon_actuators(model, mujoco)
        self._motors: dict[int, str] = {}
        """Names of motors by the tendon that they pull."""
        self._assumed = ["friction.mu_c"]
        self._taken = {"base"}
        self._axes: set[str] = set()
        """Names of joints and motors."""
        self._joint_names = [
            self._name(self._label("JOINT", k), self._axes) for k in range(model.njnt)
        ]

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
                        "every branch is a cable of its own, at its full length"
                    )
        if not cables:
            raise UsageError(
                f"{printable(self._title)} has no spatial tendon that can become a cable"
                + "".join(f"; {remark}" for remark in said_once(self._remarks))
            )
        document = {
            "name": self._name(Path(self._title).stem),
            "motors": [{"name": name} for name in dict.fromkeys(self._motors.values())],
            "joints": self._all_joints(),
            "frames": self._frames,
            "friction": {"mu_c": 0.1},
            "cables": cables,
            "assumed": self._assumed,
        }
        self._remark_on_the_rest()
        return Imported(document, self._remarks)

    def _label(self, kind: str, index: int) -> str:
        objects = self._mujoco.mjtObj
        found = self._mujoco.mj_id2name(self._model, getattr(objects, f"mjOBJ_{kind}"), index)
        return found or f"{kind.lower()}_{index}"

    def _name(self, wanted: str, taken: set[str] | None = None) -> str:
        """Unused name that a robot file allows, as close to ``wanted`` as possible.

        Args:
            wanted: name in the model.
            taken: those of entries that must not share a name: frames and cables, by default.
        """
        taken = self._taken if taken is None else taken
        plain = re.sub(r"[^A-Za-z0-9_]", "_", wanted)
        plain = plain if plain[:1].isalpha() else f"m_{plain}"
        tries = (plain, *(f"{plain}_{k}" for k in range(2, len(taken) + 3)))
        name = next(one for one in tries if one not in taken)
        taken.add(name)
        if name != wanted:
            self._renamed[name] = f"{printable(wanted)} is {name}"
        return name

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
                place = self._point(name, body, self._model.site_pos[target])
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
        point = self._point(name, body, model.geom_pos[geom])
        if point is None:
            return None
        radius = float(model.geom_size[geom][0])
        kind = "cylinder" if round_bar else "sphere"
        node = {"type": kind, "radius": radius, **point, "ignored_inside": True}
        if round_bar:
            turned = np.empty(3)
            self._mujoco.mju_rotVecQuat(turned, np.array([0.0, 0.0, 1.0]), model.geom_quat[geom])
            node["axis"] = _numbers(turned)
        if side < 0:
            return node
        carrier = int(model.site_bodyid[side])
        if carrier != body:
            if not self._carry(name, carrier):
                return None
            self._remarks.append(
                f"{name} passes outside {label} on the side of {self._label('SITE', side)} of "
                "another body, also in poses in which MuJoCo lets it through the inside since "
                "that site lies there"
            )
            node["side_frame"] = self._bodies[carrier][0]
        elif np.linalg.norm(model.site_pos[side] - model.geom_pos[geom]) < radius:
            node["inside"] = True
            return node
        node["side"] = _numbers(model.site_pos[side] + self._bodies[carrier][1])
        return node

    def _point(self, name: str, body: int, position: Any) -> Document | None:
        """Frame and position of a point of a body; None if the body cannot become a frame."""
        if not self._carry(name, body):
            return None
        frame, origin = self._bodies[body]
        return {"frame": frame, "position": _numbers(position + origin)}

    def _carry(self, name: str, body: int) -> bool:
        """Add the frames of a body and of its ancestors; False if a ball joint prevents it."""
        if body in self._bodies:
            return True
        model = self._model
        parent = int(model.body_parentid[body])
        if not self._carry(name, parent):
            return False
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = list(range(first, first + count)) if count else []
        types = self._mujoco.mjtJoint
        for joint in joints:
            if model.jnt_type[joint] == types.mjJNT_BALL:
                self._remarks.append(
                    f"{name} is left out: it depends on the ball joint "
                    f"{self._label('JOINT', joint)}, which has no single angle"
                )
                return False
        free = [joint for joint in joints if model.jnt_type[joint] == types.mjJNT_FREE]
        for joint in free:
            self._remarks.append(
                f"the free joint {self._label('JOINT', joint)} is held at its place in the model"
            )
        self._add_frames(body, parent, [joint for joint in joints if joint not in free])
        return True

    def _add_frames(self, body: int, parent: int, joints: list[int]) -> None:
        """Add one frame for every joint of a body, or a fixed frame if it has none."""
        model = self._model
        carrier, origin = self._bodies[parent]
        label = self._label("BODY", body)
        w, x, y, z = _numbers(model.body_quat[body])
        turned, at = np.empty(3), np.zeros(3)
        for k, joint in enumerate(joints):
            position = np.array(model.jnt_pos[joint])
            self._mujoco.mju_rotVecQuat(turned, position, model.body_quat[body])
            start = model.body_pos[body] + origin + turned if k == 0 else position - at
            frame: Document = {
                "name": self._name(label if k == len(joints) - 1 else f"{label}_{k + 1}"),
                "parent": carrier,
            }
            slides = model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_SLIDE
            frame["motion"] = "prismatic" if slides else "revolute"
            frame["joint"] = self._joint_names[joint]
            frame["origin"] = _numbers(start)
            if k == 0:
                frame["quaternion"] = [x, y, z, w]
            frame["axis"] = _numbers(model.jnt_axis[joint])
            frame["offset"] = 0.0 - float(model.qpos0[model.jnt_qposadr[joint]])
            self._frames.append(frame)
            self._joints.append(joint)
            carrier, at = frame["name"], position
        if not joints:
            name = self._name(label)
            self._frames.append(
                {
                    "name": name, "parent": carrier, "motion": "fixed",
                    "origin": _numbers(model.body_pos[body] + origin), "quaternion": [x, y, z, w],
                }
            )  # fmt: skip
            carrier = name
        self._bodies[body] = (carrier, -at)

    def _motor(self, tendon: int, name: str) -> str:
        """Name of the motor that pulls a tendon; empty for a passive cable."""
        if tendon not in self._motors:
            actuators = self._actuators.get(tendon, [])
            if actuators:
                names = [self._label("ACTUATOR", one) for one in actuators]
                self._motors[tendon] = self._name(names[0], self._axes)
                gear = float(self._model.actuator_gear[actuators[0], 0])
                if gear != 1.0:
                    self._remarks.append(
                        f"{name}: the gear {gear:g} of its actuator is not carried over: the "
                        "radius of its drum is assumed"
                    )
                if names[1:]:
                    self._remarks.append(
                        f"{name} is pulled by {', '.join(names)}: the first one turns its drum"
                    )
            elif self._model.nu or rest_length_of(self._model, tendon) > 0.0:
                return ""
            else:
                self._motors[tendon] = self._name(f"{name}_motor", self._axes)
                self._remarks.append(
                    f"{name}: its motor is assumed, for the model has no actuators"
                )
        return self._motors[tendon]

    def _all_joints(self) -> list[Document]:
        """Joints that move frames, and those that they follow."""
        moving = self._followed()
        others = [j for j, one in self._following.items() if one.leader in moving]
        found = []
        for joint in dict.fromkeys([*moving, *others]):
            own = self._joint(joint)
            if one := self._following.get(joint):
                coupled = {self._joint_names[one.leader]: one.share}
                own = {"name": own["name"], "coupled": coupled, "offset": one.offset}
            found.append(own)
        return found

    def _followed(self) -> dict[int, None]:
        """Joints that move frames, and the leaders of those that follow."""
        leaders = [one.leader for j in self._joints if (one := self._following.get(j))]
        return dict.fromkeys([*self._joints, *leaders])

    def _joint(self, joint: int) -> Document:
        model, label = self._model, self._label("JOINT", joint)
        slides = model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_SLIDE
        span = _numbers(model.jnt_range[joint])
        if not model.jnt_limited[joint] and joint not in self._following:
            span = [-1.0, 1.0] if slides else [-pi, pi]
            self._remarks.append(
                f"{label} has no limits: its range is assumed, {span[0]:g} to {span[1]:g}"
            )
        name = self._joint_names[joint]
        if not model.jnt_limited[joint] and joint not in self._following:
            self._assumed += [f"joints.{name}.range.1", f"joints.{name}.range.2"]
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        return {
            "name": name,
            "range": span,
            "reference_angle": min(max(reference, span[0]), span[1]),
        }

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
            cable["preload"] = PRELOAD
            self._assumed.append(f"cables.{name}.preload")
        cable["nodes"] = nodes
        return cable

    def _remark_on_the_rest(self) -> None:
        model = self._model
        others = set(self._joint_names) - {self._joint_names[j] for j in self._followed()}
        renamed = [said for name, said in self._renamed.items() if name not in others]
        if renamed:
            more = len(renamed) - NAMED
            self._remarks.append(
                f"names have letters, digits and _ only, each once: {', '.join(renamed[:NAMED])}"
                + (f", and {more} more in the same way" if more > 0 else "")
            )
        self._remarks += other_constraints(model, self._mujoco, self._label)
        self._remarks += other_actuators(model, self._mujoco, self._label, self._followed())
        self._remarks += other_properties(model, self._mujoco, self._label, self._followed())
