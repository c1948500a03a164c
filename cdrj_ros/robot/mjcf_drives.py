"""Actuators, springs and couplings of a compiled MuJoCo model, and what is said of its tendons."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

PULLEY: Final = 2
"""MuJoCo's code of the beginning of a branch, ``mjWRAP_PULLEY``."""

LARGE: Final = 1.0
"""Length of a tendon [m] beyond which its thickness may show that lengths are not in m; 0.7 in
MyoSuite's whole body."""

SLENDER: Final = 150.0
"""Length over thickness of a tendon beyond which that is said; up to 150 in public models."""

THICKEST: Final = 0.05
"""Thickness of a tendon beyond which that is said, too [m]."""

HELD: Final = -1
"""Leader of a joint that stands still."""

Label = Callable[[str, int], str]
"""Name of an object of the model, from its kind in capitals and its index."""


@dataclass(frozen=True)
class Following:
    """A joint whose angle is a linear function of that of another one, or constant."""

    leader: int
    """Index of the other joint; ``HELD`` where there is none."""
    share: float
    offset: float


def following_joints(model: Any, mujoco: Any) -> dict[int, Following]:
    """Joints that linear equality constraints couple to joints with angles of their own, or hold.

    MuJoCo's polynomial is one of the changes since qpos0: q1 = q1_0 + a0 + a1 (q2 - q2_0).
    """
    zero = [float(model.qpos0[address]) for address in model.jnt_qposadr]
    found: dict[int, Following] = {}
    for k in np.flatnonzero(_linear(model, mujoco)).tolist():
        joint, leader = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
        first, slope = (float(value) for value in model.eq_data[k, :2])
        if leader < 0 or slope == 0.0:
            found.setdefault(joint, Following(HELD, 0.0, zero[joint] + first))
        elif joint not in found:
            found[joint] = Following(leader, slope, zero[joint] + first - slope * zero[leader])
    for joint in [*found]:
        seen = {joint}
        while (one := found.get(joint)) and (other := found.get(one.leader)):
            if one.leader in seen:  # a ring of joints, each of which follows the next one
                del found[joint]
                break
            seen.add(one.leader)
            found[joint] = Following(
                other.leader, one.share * other.share, one.offset + one.share * other.offset
            )
    return found


def _linear(model: Any, mujoco: Any) -> Any:
    """Which constraints are active and couple one joint linearly to another, or hold it."""
    linear = (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & (model.eq_active0 != 0)
    return linear & ((model.eq_obj2id < 0) | (model.eq_data[:, 2:5] == 0.0).all(axis=1))


def other_constraints(model: Any, mujoco: Any, label: Label) -> Iterator[tuple[str, str]]:
    """Every equality constraint that is not carried over, with what it is between, and a remark."""
    kinds = mujoco.mjtEq
    between = {
        kinds.mjEQ_JOINT: "JOINT", kinds.mjEQ_TENDON: "TENDON",
        kinds.mjEQ_WELD: "BODY", kinds.mjEQ_CONNECT: "BODY",
    }  # fmt: skip
    following, linear, taken = following_joints(model, mujoco), _linear(model, mujoco), set[int]()
    for k in range(model.neq):
        kind = mujoco.mjtEq(model.eq_type[k])
        ends = [int(one[k]) for one in (model.eq_obj1id, model.eq_obj2id) if one[k] >= 0]
        if int(model.eq_objtype[k]) == int(mujoco.mjtObj.mjOBJ_SITE):
            ends = [int(model.site_bodyid[one]) for one in ends]
        name = f"equality constraint {label('EQUALITY', k)}"
        if kind in between:
            name += f" of {' and '.join(label(between[kind], one) for one in ends)}"
        if not model.eq_active0[k]:
            yield name, "is not active"
        elif kind == kinds.mjEQ_JOINT and not linear[k]:
            yield name, "is not linear: the first joint stays a measured joint"
        elif kind == kinds.mjEQ_JOINT:
            if ends[0] in taken or ends[0] not in following:
                yield name, "is left out: the first joint follows another one, or itself, already"
            taken.add(ends[0])
        elif kind == kinds.mjEQ_TENDON:
            yield name, "is left out: each tendon is a cable of its own"
        elif kind in between:
            yield name, "is left out: arms count as if these bodies moved freely"
        else:
            yield name, "is left out: it is not between joints, bodies or tendons"


def tendon_actuators(model: Any, mujoco: Any) -> dict[int, list[int]]:
    """Actuators by the tendon that they pull."""
    found: dict[int, list[int]] = {}
    for k in np.flatnonzero(model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON).tolist():
        found.setdefault(int(model.actuator_trnid[k, 0]), []).append(k)
    return found


def other_actuators(
    model: Any, mujoco: Any, label: Label, moving: Collection[int]
) -> Iterator[tuple[str, str]]:
    """Name of every actuator that pulls no tendon, and a remark.

    Args:
        model: the compiled model.
        mujoco: the package.
        label: names its objects.
        moving: joints of the robot file.
    """
    kinds = mujoco.mjtTrn
    without = "without a cable: it is not among the motors, and the joint is measured"
    for k in range(model.nu):
        kind, target = int(model.actuator_trntype[k]), int(model.actuator_trnid[k, 0])
        name = label("ACTUATOR", k)
        if kind == kinds.mjTRN_TENDON:
            if model.wrap_type[model.tendon_adr[target]] == mujoco.mjtWrap.mjWRAP_JOINT:
                yield name, "pulls a fixed tendon, which has no path: it is left out"
        elif kind not in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            yield name, "drives neither a joint nor a tendon: it is left out"
        elif target not in moving:
            yield name, "drives a joint that moves no cable: it is left out"
        elif (joint := label("JOINT", target)) == name:
            yield name, f"drives the joint of its name {without}"
        else:
            yield f"{name} on {joint}", f"drives the joint {without}"


def rest_length_of(model: Any, tendon: int) -> float:
    """Length above which a tendon pulls without an actuator [m]; 0 where it never does.

    It is the upper end of the slack range of its spring, or of the range of its length.  Branches
    have none, for MuJoCo gives one length to all of them.
    """
    first = int(model.tendon_adr[tendon])
    steps = model.wrap_type[first : first + int(model.tendon_num[tendon])]
    if (steps == PULLEY).any():
        return 0.0
    if stiffness_of(model, tendon) > 0.0:
        return float(np.ravel(model.tendon_lengthspring[tendon])[-1])
    return float(model.tendon_range[tendon, 1]) if model.tendon_limited[tendon] else 0.0


def stiffness_of(model: Any, tendon: int) -> float:
    """Stiffness of a tendon's spring [N/m]; its linear part."""
    return float(np.ravel(model.tendon_stiffness[tendon])[0])


def other_properties(
    model: Any, mujoco: Any, label: Label, moving: Collection[int]
) -> Iterator[str]:
    """What is said of numbers that are not carried over, or look wrong; ``moving`` as above."""
    spatial = model.wrap_type[model.tendon_adr] != mujoco.mjtWrap.mjWRAP_JOINT
    longest = int(np.argmax(model.tendon_length0 * spatial))
    length, thickness = (
        float(one[longest]) for one in (model.tendon_length0, 2.0 * model.tendon_width)
    )
    if length > max(LARGE, SLENDER * thickness) or thickness > THICKEST:
        yield (
            f"tendon {label('TENDON', longest)} is {length:.3g} m long and {1e3 * thickness:g} mm "
            "thick: are all lengths of the model in m?"
        )
    linear = np.zeros(model.ntendon)
    for name, numbers, why in (
        ("frictionloss", model.tendon_frictionloss, "friction follows from mu_c and the wraps"),
        ("damping", model.tendon_damping, "cables are not damped"),
        ("a stiffness that is not linear", getattr(model, "tendon_stiffnesspoly", linear),
         "the spring is its linear part"),
    ):  # fmt: skip
        own = np.reshape(numbers, (model.ntendon, -1)).any(axis=1) & spatial
        if own.any():
            names = ", ".join(label("TENDON", k) for k in np.flatnonzero(own).tolist())
            yield f"{name} of {names} is not carried over: {why}"
    for name, numbers, key in (
        ("stiffness", model.jnt_stiffness, "spring_stiffness and spring_rest"),
        ("frictionloss", model.dof_frictionloss[model.jnt_dofadr], "bearing_torque"),
    ):
        joints = [label("JOINT", k) for k in moving if float(np.ravel(numbers[k])[0]) > 0.0]
        if joints:
            named = ", ".join(joints)
            yield f"{name} of {named} is not carried over: {key} of a joint, for its effort alone"
