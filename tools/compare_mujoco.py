#!/usr/bin/env python3
"""Compare imported spatial tendons with MuJoCo: lengths and moment arms in random poses.

python tools/compare_mujoco.py FOLDER [--poses N]    every MJCF model below FOLDER
"""

from __future__ import annotations

import argparse
import re
import sys
from contextlib import suppress
from copy import copy, deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.model.prepared import Model, prepare, shape_at
from cdrj_ros.robot.imported import robot_text
from cdrj_ros.robot.mjcf import load_mujoco, read_mjcf
from cdrj_ros.robot.mjcf_bodies import Bodies
from cdrj_ros.robot.mjcf_drives import HELD, following_joints
from cdrj_ros.robot.reader import parse_robot

LENGTH = 1e-9
"""Largest accepted difference of lengths [m]."""

ARM = 1e-7
"""Largest accepted difference of moment arms [m/rad] or [m/m]."""

THINNER = 2e-6
"""Share by which wrapping bodies are made thinner where rounding may decide in MuJoCo."""

ALIKE = 1e-5
"""Largest difference that this makes to a length here, over the largest radius."""

STEP = 1e-4
"""Step of the differences of MuJoCo's lengths [rad] or [m]."""


@dataclass(frozen=True)
class Comparison:
    """One model against MuJoCo."""

    tendons: int
    """Spatial tendons of the model."""
    compared: int
    """Those that could be imported."""
    joints: int
    touched: int
    """Wrapping bodies that were touched in some pose."""
    length: float
    """Largest difference of lengths [m]."""
    arm: float
    """Largest difference of moment arms [m/rad] or [m/m]."""
    beyond: int
    """Triples of tendon, pose and joint whose difference is above ``ARM``."""
    slope: float
    """Of these, the largest difference from the derivative of MuJoCo's length [m/rad] or [m/m].

    MuJoCo ends its iteration at rings early: to first order in the remaining error this changes
    its moment arms, but not its lengths.
    """
    impossible: int
    """Pairs of tendon and pose without a path here: a point lies inside a wrapping body."""
    rounding: int
    """Pairs of tendon and pose, left out, in which rounding decides in MuJoCo on which side of a
    rim a point lies: where all bodies are thinner by ``THINNER``, it agrees."""
    turns: int
    """Pairs of tendon and pose, left out, in which MuJoCo wraps a strand round a body that it does
    not cut, at most grazes, and so adds up to a turn to it."""

    @property
    def agrees(self):
        """Whether all compared values agree."""
        return self.length <= LENGTH and self.slope <= ARM


def compare(path, poses=1000):
    """Compare all spatial tendons of a model in random poses within the joint ranges.

    Tendons are imported one by one, so that a pose that is impossible for one of them does not
    keep the others from being compared.

    Raises:
        CdrjError: the model cannot be read, or has no spatial tendon that can be imported.
    """
    mujoco = load_mujoco()
    every = read_mjcf(path)
    mj = mujoco.MjModel.from_xml_path(str(path))
    mj.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)  # sleeping bodies are not placed
    thin = copy(mj)
    thin.geom_size[:, 0] *= 1.0 - THINNER
    theirs, thinner = Theirs(mujoco, mj), Theirs(mujoco, thin)
    spatial = [k for k in range(mj.ntendon) if mj.wrap_type[mj.tendon_adr[k]] != 1]
    robots = {}
    for k in spatial:
        with suppress(UsageError):  # it cannot be imported
            robots[k] = _one(mujoco, mj, path, k)
    generator = np.random.default_rng(0)
    length = arm = slope = 0.0
    impossible = beyond = 0
    left_out = {"": 0, "rounding": 0, "turns": 0}
    touched = set()
    low, high = joint_ranges(mujoco, mj)
    for _ in range(poses):
        drawn = low + generator.random(mj.njnt) * (high - low)
        pose = mj.qpos0.copy()
        for robot in robots.values():
            robot.pose(mj, drawn, pose)
        theirs.place(pose)
        thinner.place(pose)
        for k, robot in robots.items():
            shape = shape_at(robot.model, drawn[robot.joints])
            if not shape.possible:
                impossible += 1
                continue
            touched |= {(k, int(p)) for p in np.flatnonzero(shape.wrap > 0.0)}
            own = robot.own(robot.model, drawn)
            difference = np.abs(own - theirs.of(k, robot))
            why = "" if _alike(difference) else _left_out(k, robot, drawn, own, theirs, thinner)
            left_out[why] += 1
            if why:
                continue
            length = max(length, float(difference[0]))
            arm = max(arm, float(difference[1:].max(initial=0.0)))
            for j in np.flatnonzero(difference[1:] > ARM):
                beyond += 1
                slopes = np.zeros(mj.njnt)
                for joint in (robot.joints[j], *(one for one, _, _ in robot.coupled)):
                    slopes[joint] = slope_of_length(mujoco, mj, pose, k, joint)
                slope = max(slope, abs(float(own[1 + j] - robot.by_own_joints(slopes)[j])))
    return Comparison(
        len(spatial), len(robots), len(every.document["joints"]), len(touched), length, arm, beyond,
        slope, impossible, left_out["rounding"], left_out["turns"],
    )  # fmt: skip


def _alike(difference):
    """Whether a length and its moment arms agree."""
    return bool(difference[0] <= LENGTH and (difference[1:] <= ARM).all())


def _left_out(tendon, robot, drawn, own, theirs, thinner):
    """Why a tendon is not compared in a pose in which it differs; empty if it is."""
    thin = robot.own(robot.thin, drawn)
    widest = float(theirs.mj.geom_size[:, 0].max(initial=0.0))
    if abs(own[0] - thin[0]) <= ALIKE * widest and _alike(np.abs(thin - thinner.of(tendon, robot))):
        return "rounding"
    longer = theirs.of(tendon, robot)[0] > own[0]
    return "turns" if longer and theirs.wraps_without_cutting(tendon) else ""


@dataclass
class Theirs:
    """MuJoCo's lengths and moment arms in a pose."""

    mujoco: Any
    mj: Any
    """``MjModel``."""

    def place(self, pose):
        """Compute them."""
        self.data = self.mujoco.MjData(self.mj)
        self.data.qpos[:] = pose
        for stage in (self.mujoco.mj_kinematics, self.mujoco.mj_comPos, self.mujoco.mj_tendon):
            stage(self.mj, self.data)
        self._arms = moment_arms(self.mj, self.data)

    def of(self, tendon, robot):
        """Length and moment arms of a tendon."""
        found = robot.by_own_joints(self._arms[tendon, self.mj.jnt_dofadr])
        return np.array([self.data.ten_length[tendon], *found])

    def wraps_without_cutting(self, tendon):
        """Whether it wraps a tendon round a body that the straight strand does not cut."""
        mj, data = self.mj, self.data
        first, count = int(data.ten_wrapadr[tendon]), int(data.ten_wrapnum[tendon])
        wrapped = np.ravel(data.wrap_obj)[first : first + count].tolist()
        path = range(mj.tendon_adr[tendon], mj.tendon_adr[tendon] + mj.tendon_num[tendon])
        kinds = self.mujoco.mjtWrap
        for k in path:
            kind, geom = int(mj.wrap_type[k]), int(mj.wrap_objid[k])
            if kind not in (kinds.mjWRAP_CYLINDER, kinds.mjWRAP_SPHERE) or geom not in wrapped:
                continue
            seen = slice(0, 2 if kind == kinds.mjWRAP_CYLINDER else 3)
            turned = data.geom_xmat[geom].reshape(3, 3)
            before, after = (
                ((data.site_xpos[mj.wrap_objid[one]] - data.geom_xpos[geom]) @ turned)[seen]
                for one in (k - 1, k + 1)
            )
            way = after - before
            share = np.clip(-(way @ before) / max(float(way @ way), 1e-300), 0.0, 1.0)
            if np.linalg.norm(before + share * way) >= (1.0 - THINNER) * mj.geom_size[geom, 0]:
                return True
        return False


def joint_ranges(mujoco, mj):
    """Lower and upper end of every joint's range; ±180° or ±1 m for joints without limits."""
    most = np.where(mj.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE, 1.0, np.pi)
    limited = mj.jnt_limited.astype(bool)
    low = np.where(limited, mj.jnt_range[:, 0], -most)
    return low, np.where(limited, mj.jnt_range[:, 1], most)


@dataclass(frozen=True)
class Imported:
    """The robot of one tendon."""

    model: Model
    thin: Model
    """With thinner bodies."""
    joints: NDArray[np.int64]
    """MuJoCo's index of every joint."""
    coupled: list[tuple[int, NDArray[np.float64], float]]
    """Of every joint that follows others, or stands still, MuJoCo's index, its shares of all joints
    of the robot, and its offset."""
    weights: NDArray[np.float64]
    """Share of every element in MuJoCo's length."""

    def pose(self, mj, drawn, qpos):
        """Write the angles of its joints, of all that were drawn, into MuJoCo's pose."""
        qpos[mj.jnt_qposadr[self.joints]] = drawn[self.joints]
        for joint, shares, offset in self.coupled:
            qpos[mj.jnt_qposadr[joint]] = offset + shares @ drawn[self.joints]

    def own(self, model, drawn):
        """Length and moment arms of one of its models."""
        shape = shape_at(model, drawn[self.joints])
        return np.array([self.weights @ shape.length, *(self.weights @ shape.lever_arm)])

    def by_own_joints(self, slopes):
        """Derivatives by its joints from those by all joints of MuJoCo, of which some follow."""
        found = slopes[self.joints].copy()
        for joint, shares, _ in self.coupled:
            found += slopes[joint] * shares
        return found


def _one(mujoco, mj, path, tendon):
    """The robot of one tendon, through the text of its file."""
    bodies = Bodies(mujoco, mj)
    label = bodies.label
    imported = read_mjcf(path, [label("TENDON", tendon)])
    model, thin = (
        prepare(parse_robot(robot_text(one, imported.remarks, path.name)), check_range=False)
        for one in (imported.document, _thinner(imported.document))
    )
    names = [bodies.name(label("JOINT", j), {}) for j in range(mj.njnt)]
    joints = np.array([names.index(one.name) for one in model.robot.joints], dtype=np.int64)
    branches = [[1.0, 0]]  # divisor, and number of sites and bodies
    first = mj.tendon_adr[tendon]
    for k in range(first, first + mj.tendon_num[tendon]):
        if mj.wrap_type[k] == mujoco.mjtWrap.mjWRAP_PULLEY:
            branches.append([float(mj.wrap_prm[k]), 0])
        else:
            branches[-1][1] += 1
    divisors = [divisor for divisor, count in branches if count > 1]
    cables = model.robot.cables
    if len(cables) != len(divisors):
        raise UsageError("a branch cannot be imported")
    shares = [np.full(len(c.nodes) - 1, 1.0 / d) for c, d in zip(cables, divisors, strict=True)]
    own = [joint.name for joint in model.robot.joints]
    coupled = [
        (
            names.index(entry["name"]),
            np.array([float(entry["coupled"].get(name, 0.0)) for name in own]),
            float(entry["offset"]),
        )
        for entry in model.robot.document["joints"]
        if "coupled" in entry
    ]
    still = [(j, one) for j, one in following_joints(mj, mujoco).items() if one.leader == HELD]
    coupled += [(j, np.zeros(len(own)), one.offset) for j, one in still]
    return Imported(model, thin, joints, coupled, np.concatenate(shares))


def _thinner(document):
    """The document with thinner bodies."""
    found = deepcopy(document)
    for cable in found["cables"]:
        for node in cable["nodes"]:
            if node["type"] in ("cylinder", "sphere"):
                node["radius"] *= 1.0 - THINNER
    return found


def moment_arms(mj, data):
    """MuJoCo's dense matrix of d length / d velocity, shape (tendons, velocities)."""
    values = np.asarray(data.ten_J)
    if values.size == mj.ntendon * mj.nv:
        return values.reshape(mj.ntendon, mj.nv)
    dense = np.zeros((mj.ntendon, mj.nv))
    sparse = mj if hasattr(mj, "ten_J_rownnz") else data  # MuJoCo moved them to the model
    places = sparse.ten_J_rownnz, sparse.ten_J_rowadr, np.ravel(sparse.ten_J_colind)
    load_mujoco().mju_sparse2dense(dense, np.ravel(values), *places)
    return dense


def slope_of_length(mujoco, mj, pose, tendon, joint):
    """Derivative of MuJoCo's length of a tendon by a joint, by central differences of order 4."""
    moved, total = Theirs(mujoco, mj), 0.0
    for steps, weight in ((-2, 1.0), (-1, -8.0), (1, 8.0), (2, -1.0)):
        there = pose.copy()
        there[mj.jnt_qposadr[joint]] += steps * STEP
        moved.place(there)
        total += weight * float(moved.data.ten_length[tendon])
    return total / (12.0 * STEP)


def main():
    """Print a table, and return 1 where a model disagrees."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--poses", type=int, default=1000)
    arguments = parser.parse_args()
    worst = True
    if (version := str(load_mujoco().__version__)).startswith("3."):
        print(f"note: sides of bodies follow the rule of MuJoCo 4; that of {version} differs")
    print(
        "model | tendons | compared | joints | bodies touched | length [m] | arm [m/rad] | "
        "beyond | there by length | no path | by rounding | turns more"
    )
    for path in sorted(arguments.folder.rglob("*.xml")):
        if not re.search(rb"<mujoco[\s>]", path.read_bytes()):  # a part of a model is not one
            continue
        name = path.relative_to(arguments.folder)
        try:
            found = compare(path, arguments.poses)
        except CdrjError as error:
            if "has no spatial tendon" not in str(error) or ";" in str(error):
                print(f"{name}: {str(error)[:200]}")
            continue
        worst &= found.agrees
        print(
            f"{name} | {found.tendons} | {found.compared} | {found.joints} | {found.touched} | "
            f"{found.length:.1e} | {found.arm:.1e} | {found.beyond} | {found.slope:.1e} | "
            f"{found.impossible} | {found.rounding} | {found.turns}"
            + ("" if found.agrees else "  DISAGREES"),
            flush=True,
        )
    return 0 if worst else 1


if __name__ == "__main__":
    sys.exit(main())
