"""Motors that follow the joints, and the tensions that result from geometry and statics alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cdrj_ros.model.elasticity import elasticity_of, modulus_at, strain_at, tensions_at
from cdrj_ros.model.prepared import Model
from cdrj_ros.robot.description import Robot, Winch

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


def cable_per_turn(robot: Robot) -> Matrix:
    """Cable wound in per radian of every motor [m], shape (cables, motors)."""
    names = [motor.name for motor in robot.motors]
    drums = np.zeros((len(robot.cables), len(names)))
    for c, cable in enumerate(robot.cables):
        for node in (cable.nodes[0], cable.nodes[-1]):
            if isinstance(node, Winch):
                drums[c, names.index(node.motor)] += node.winding * node.reel
    return drums


def stiffness_at_preload(robot: Robot, length: Vector) -> Vector:
    """dT / dL of every cable at its preload [N/m], EA / length where it is linear.

    Args:
        robot: the robot.
        length: total length of every cable in the reference pose [m], shape (cables,).
    """
    moduli = [modulus_at(elasticity_of(cable), cable.preload) for cable in robot.cables]
    return np.array(moduli) / length


def follow_joints(
    robot: Robot, whole: Matrix, stiffness: Vector, drums: Matrix
) -> tuple[Matrix, Matrix]:
    """Motor angles that keep the preloads in the least-squares sense, and the tensions that result.

    The motors follow with the stiffness at the preload; the tensions follow from each cable's law.

    Returns:
        Motor angles from the reference [rad], (poses, motors), and tensions [N], (poses, cables).
    """
    wanted = whole[0] - whole  # length to be wound in, (poses, cables)
    angles = np.linalg.lstsq(stiffness[:, None] * drums, (stiffness * wanted).T, rcond=None)[0].T
    preload = np.array([cable.preload for cable in robot.cables])
    taken_up = angles @ drums.T - wanted
    tension = preload + stiffness * taken_up
    for c, cable in enumerate(robot.cables):
        if cable.bedding_strain:
            law = elasticity_of(cable)
            strain = strain_at(law, cable.preload) + taken_up[:, c] / whole[0, c]
            tension[:, c] = tensions_at(law, strain)
    return angles, np.maximum(tension, 0.0)


def loaded_tensions(
    model: Model,
    loads: Mapping[str, float],
    poses: Matrix,
    whole_by: NDArray[np.float64],
    followed: Matrix,
    stiffness: Vector,
    drums: Matrix,
) -> tuple[Matrix, list[tuple[float, ...]]]:
    """Frictionless tensions that exert the loads and are closest to the tensions without loads.

    With an additional motor angle d and the stiffness k at the preload, t = t_follow + k B d >= 0
    and -A^T t = load on the named joints.  Minimising max |t - t_follow| is a linear program in d
    and that maximum.
    """
    from scipy.optimize import linprog  # slow to import, so only where used

    named = [model.layout.joints.index(name) for name in loads]
    efforts = np.array(list(loads.values()))
    turned = stiffness[:, None] * drums  # k B
    count, motors = turned.shape
    rows = np.vstack(
        [
            np.hstack([-turned, np.zeros((count, 1))]),
            np.hstack([turned, -np.ones((count, 1))]),
            np.hstack([-turned, -np.ones((count, 1))]),
        ]
    )
    scale = max(1.0, float(np.abs(efforts).max()))
    tensions = followed.copy()
    unbalanced = []
    for k in range(poses.shape[0]):
        arms = -whole_by[k][:, named].T  # shape (efforts, tensions)
        result = linprog(
            np.append(np.zeros(motors), 1.0),
            A_ub=rows,
            b_ub=np.concatenate([followed[k], np.zeros(2 * count)]),
            A_eq=np.hstack([arms @ turned, np.zeros((len(named), 1))]) / scale,
            b_eq=(efforts - arms @ followed[k]) / scale,
            bounds=[(None, None)] * motors + [(0.0, None)],
        )
        if result.success:
            tensions[k] = np.maximum(followed[k] + turned @ result.x[:-1], 0.0)
        else:
            unbalanced.append(tuple(poses[k].tolist()))
    return tensions, unbalanced
