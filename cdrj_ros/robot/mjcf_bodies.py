"""Bodies and joints of a compiled MuJoCo model as frames and joints of a robot file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from math import pi
from types import ModuleType
from typing import Any, Final

import numpy as np

from cdrj_ros.foundation.output import listed, printable
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.mjcf_drives import HELD, following_joints

NAMED: Final = 3
"""Number of names that differ from the model's of which a remark tells both."""


def numbers_of(values: Any) -> list[float]:
    """Plain numbers of an array."""
    return [float(value) for value in values]


class Bodies:
    """Frames and joints that cables need, added as they do."""

    def __init__(self, mujoco: ModuleType, model: Any) -> None:
        """None are there yet but the base, which is the world."""
        self._mujoco, self._model = mujoco, model
        self.remarks: list[str] = []
        """On what is not represented, also by those that add cables."""
        self.assumed = ["friction.mu_c"]
        """Paths of guessed numbers, likewise."""
        self.frames: list[Document] = []
        self.places: dict[int, tuple[str, Any]] = {0: ("base", np.zeros(3))}
        """Frame of every body, and the body's origin in it [m]."""
        self.axes: dict[str, int] = {}
        """Names of joints and motors, and the last number behind each."""
        self._others = {"base": 1}
        """Names of frames and cables, likewise."""
        self._renamed: dict[str, str] = {}
        """What is said of names that differ from the model's, by name."""
        self._joints: list[int] = []
        self._following = following_joints(model, mujoco)
        self._joint_names = [
            self.name(self.label("JOINT", k), self.axes) for k in range(model.njnt)
        ]

    def label(self, kind: str, index: int) -> str:
        """Name in the model of an object of a kind, in capitals; a number where it has none."""
        objects = self._mujoco.mjtObj
        found = self._mujoco.mj_id2name(self._model, getattr(objects, f"mjOBJ_{kind}"), index)
        return found or f"{kind.lower()}_{index}"

    def name(self, wanted: str, taken: dict[str, int] | None = None) -> str:
        """Unused name that a robot file allows, as close to ``wanted`` as possible.

        Args:
            wanted: name in the model.
            taken: those of entries that must not share a name: frames and cables, by default.
        """
        taken = self._others if taken is None else taken
        plain = re.sub(r"[^A-Za-z0-9_]", "_", wanted)
        plain = plain if plain[:1].isalpha() else f"m_{plain}"
        name = plain
        while name in taken:
            taken[plain] += 1
            name = f"{plain}_{taken[plain]}"
        taken[name] = 1
        if name != wanted:
            self._renamed[name] = f"{printable(wanted)} is {name}"
        return name

    def point(self, name: str, body: int, position: Any) -> Document | None:
        """Frame and position of a point of a body; None if the body cannot become a frame."""
        if not self.carry(name, body):
            return None
        frame, origin = self.places[body]
        return {"frame": frame, "position": numbers_of(position + origin)}

    def carry(self, name: str, body: int) -> bool:
        """Add the frames of a body and of its ancestors; False if a ball joint prevents it."""
        if body in self.places:
            return True
        model = self._model
        parent = int(model.body_parentid[body])
        if not self.carry(name, parent):
            return False
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = list(range(first, first + count)) if count else []
        types = self._mujoco.mjtJoint
        for joint in joints:
            if model.jnt_type[joint] == types.mjJNT_BALL:
                self.remarks.append(
                    f"{name} is left out: it depends on the ball joint "
                    f"{self.label('JOINT', joint)}, which has no single angle"
                )
                return False
        free = [joint for joint in joints if model.jnt_type[joint] == types.mjJNT_FREE]
        for joint in free:
            self.remarks.append(
                f"the free joint {self.label('JOINT', joint)} is held at its place in the model"
            )
        self._add_frames(body, parent, [joint for joint in joints if joint not in free])
        return True

    def _add_frames(self, body: int, parent: int, joints: list[int]) -> None:
        """Add one frame for every joint of a body, or a fixed frame if it has none."""
        model = self._model
        carrier, origin = self.places[parent]
        label = self.label("BODY", body)
        w, x, y, z = numbers_of(model.body_quat[body])
        turned, at = np.empty(3), np.zeros(3)
        for k, joint in enumerate(joints):
            position = np.array(model.jnt_pos[joint])
            self._mujoco.mju_rotVecQuat(turned, position, model.body_quat[body])
            start = model.body_pos[body] + origin + turned if k == 0 else position - at
            frame: Document = {
                "name": self.name(label if k == len(joints) - 1 else f"{label}_{k + 1}"),
                "parent": carrier,
            }
            one = self._following.get(joint)
            if one is not None and one.leader == HELD:
                frame |= self._held(joint, start, one.offset, first=k == 0)
                self.frames.append(frame)
                carrier, at = frame["name"], position
                continue
            slides = model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_SLIDE
            frame["motion"] = "prismatic" if slides else "revolute"
            frame["joint"] = self._joint_names[joint]
            frame["origin"] = numbers_of(start)
            if k == 0:
                frame["quaternion"] = [x, y, z, w]
            frame["axis"] = numbers_of(model.jnt_axis[joint])
            frame["offset"] = 0.0 - float(model.qpos0[model.jnt_qposadr[joint]])
            self.frames.append(frame)
            self._joints.append(joint)
            carrier, at = frame["name"], position
        if not joints:
            name = self.name(label)
            self.frames.append(
                {
                    "name": name, "parent": carrier, "motion": "fixed",
                    "origin": numbers_of(model.body_pos[body] + origin), "quaternion": [x, y, z, w],
                }
            )  # fmt: skip
            carrier = name
        self.places[body] = (carrier, -at)

    def _held(self, joint: int, start: Any, angle: float, *, first: bool) -> Document:
        """A fixed frame for a joint that stands at an angle [rad] or [m].

        ``start`` is where it is in the parent [m]; the first joint of a body is turned as the body.
        """
        model, mujoco = self._model, self._mujoco
        label, slides = self.label("JOINT", joint), mujoco.mjtJoint.mjJNT_SLIDE
        self.remarks.append(f"{label} is held by an equality constraint: it is no joint here")
        body = model.body_quat[model.jnt_bodyid[joint]] if first else np.array([1.0, 0.0, 0.0, 0.0])
        moved = angle - float(model.qpos0[model.jnt_qposadr[joint]])
        way, turn, whole = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.empty(4)
        if model.jnt_type[joint] == slides:
            mujoco.mju_rotVecQuat(way, moved * model.jnt_axis[joint], body)
        else:
            mujoco.mju_axisAngle2Quat(turn, model.jnt_axis[joint], moved)
        mujoco.mju_mulQuat(whole, body, turn)
        w, x, y, z = numbers_of(whole)
        return {"motion": "fixed", "origin": numbers_of(start + way), "quaternion": [x, y, z, w]}

    def renamed(self) -> Iterator[str]:
        """What is said of names that differ from the model's."""
        others = set(self._joint_names) - {self._joint_names[j] for j in self.moving()}
        said = [text for name, text in self._renamed.items() if name not in others]
        if said:
            yield f"names have letters, digits and _ only, each once: {listed(said, NAMED)}"

    def joints(self) -> list[Document]:
        """Joints that move frames, and those that they follow."""
        moving = self.moving()
        others = [j for j, one in self._following.items() if one.leader in moving]
        found = []
        for joint in dict.fromkeys([*moving, *others]):
            own = self._joint(joint)
            if one := self._following.get(joint):
                coupled = {self._joint_names[one.leader]: one.share}
                own = {"name": own["name"], "coupled": coupled, "offset": one.offset}
            found.append(own)
        return found

    def moving(self) -> dict[int, None]:
        """Joints that move frames, and the leaders of those that follow."""
        leaders = [one.leader for j in self._joints if (one := self._following.get(j))]
        return dict.fromkeys([*self._joints, *leaders])

    def _joint(self, joint: int) -> Document:
        model, label = self._model, self.label("JOINT", joint)
        slides = model.jnt_type[joint] == self._mujoco.mjtJoint.mjJNT_SLIDE
        span, name = numbers_of(model.jnt_range[joint]), self._joint_names[joint]
        if not model.jnt_limited[joint] and joint not in self._following:
            self.assumed += [f"joints.{name}.range.1", f"joints.{name}.range.2"]
            span = [-1.0, 1.0] if slides else [-pi, pi]
            self.remarks.append(
                f"{label} has no limits: its range is assumed, {span[0]:g} to {span[1]:g}"
            )
        reference = float(model.qpos0[model.jnt_qposadr[joint]])
        return {
            "name": name,
            "range": span,
            "reference_angle": min(max(reference, span[0]), span[1]),
        }
