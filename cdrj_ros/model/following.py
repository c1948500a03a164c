"""The motor angles that follow the joints, so that every cable keeps its preload."""

from __future__ import annotations

import numpy as np

from cdrj_ros.foundation.arrays import Matrix, Vector
from cdrj_ros.model.laws import elasticity_of, modulus_at, strain_at, tensions_at
from cdrj_ros.model.prepared import Model, lengths_at
from cdrj_ros.robot.description import Robot
from cdrj_ros.robot.groups import connected_cables


def following_motors(model: Model, poses: Matrix) -> Matrix:
    """Motor angles that keep the preloads in given poses [rad], shape (poses, motors)."""
    robot = model.robot
    whole = whole_lengths(robot, lengths_at(model, np.vstack([robot.reference_pose, poses])))
    angles, _ = followed_by(robot, whole)
    return robot.reference_motors + angles[1:]


def whole_lengths(robot: Robot, length: Matrix) -> Matrix:
    """Lengths of all cables from those of their elements [m], shape (poses, cables)."""
    return np.stack([length[:, part].sum(axis=1) for part in robot.parts], axis=1)


def stiffness_at_preload(robot: Robot, length: Vector) -> Vector:
    """dT / dL of every cable at its preload [N/m], EA / length where it is linear.

    Args:
        robot: the robot.
        length: total length of every cable in the reference pose [m], shape (cables,).
    """
    moduli = [modulus_at(elasticity_of(cable), cable.preload) for cable in robot.cables]
    return np.array(moduli) / length


def followed_by(robot: Robot, whole: Matrix) -> tuple[Matrix, Matrix]:
    """Motor angles that keep the preloads in the least-squares sense, and the tensions that result.

    The motors follow with the stiffness at the preload; the tensions follow from each cable's law.

    Returns:
        Motor angles from the reference [rad], (poses, motors), and tensions [N], (poses, cables).
    """
    stiffness, radii = stiffness_at_preload(robot, whole[0]), robot.effective_radii
    wanted = whole[0] - whole  # length to be wound in, (poses, cables)
    angles = np.zeros((len(whole), len(robot.motors)))
    for group in connected_cables(robot, by_joints=False):
        own = np.array(group)
        turned = np.flatnonzero(radii[own].any(axis=0))
        pulls = stiffness[own, None] * radii[np.ix_(own, turned)]
        wound = (stiffness[own] * wanted[:, own]).T
        angles[:, turned] = np.linalg.lstsq(pulls, wound, rcond=None)[0].T
    preload = np.array([cable.preload for cable in robot.cables])
    taken_up = angles @ radii.T - wanted
    tension = preload + stiffness * taken_up
    for c, cable in enumerate(robot.cables):
        if cable.bedding_strain:
            law = elasticity_of(cable)
            strain = strain_at(law, cable.preload) + taken_up[:, c] / whole[0, c]
            tension[:, c] = tensions_at(law, strain)
    return angles, np.maximum(tension, 0.0)
