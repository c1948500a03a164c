"""Choice of the angle over which each channel is plotted."""

from __future__ import annotations

import numpy as np

from cdrj_ros.conditioning.samples import Samples
from cdrj_ros.judgement.channels import FORCE_VECTOR, Angle
from cdrj_ros.model.channels import EFFORT, NODAL_FORCE, TENSION
from cdrj_ros.model.prepared import Model, shape_at


def telling_angles(model: Model, segment: Samples) -> dict[str, Angle]:
    """Angle over which each channel is plotted, by channel name.

    A tension or nodal force is plotted over the joint that changes the length of its cable most, or
    over the cable's motor if no joint does.  An effort is plotted over its own motor or joint, but
    a motor's effort over the joint if the robot has only one.
    """
    layout, robot = model.layout, model.robot
    sliding = robot.prismatic_joints
    angles = {
        name: Angle(name, segment.stamp_ns, values[:, k], "m" if name in sliding else "rad")
        for names, values in (
            (layout.motors, segment.motor_angle),
            (layout.joints, segment.joint_angle),
        )
        for k, name in enumerate(names)
    }
    lowest = np.min(segment.joint_angle, axis=0)
    middle = 0.5 * (lowest + np.max(segment.joint_angle, axis=0))
    moves = np.abs(shape_at(model, middle).lever_arm)
    reach = moves * (np.max(segment.joint_angle, axis=0) - lowest)
    by_cable = {}
    for cable in robot.cables:
        rows = [k for k, name in enumerate(layout.elements) if name.startswith(f"{cable.name}/")]
        along = reach[rows].sum(axis=0)
        winches = [node.motor for node in cable.nodes if hasattr(node, "motor")]
        if along.size and along.max() > 0.0:
            by_cable[cable.name] = angles[layout.joints[int(along.argmax())]]
        elif winches:
            by_cable[cable.name] = angles[winches[0]]
        elif layout.joints:
            by_cable[cable.name] = angles[layout.joints[0]]
    told = {f"{EFFORT}/{name}": angle for name, angle in angles.items()}
    for prefix, names in (
        (TENSION, layout.elements),
        (NODAL_FORCE, layout.pulleys),
        (FORCE_VECTOR, layout.pulleys),
    ):
        for name in names:
            cable_name = name.rpartition("/")[0]
            if cable_name in by_cable:
                told[f"{prefix}/{name}"] = by_cable[cable_name]
    if len(layout.joints) == 1:  # the hysteresis loop is clearest over the joint angle
        told |= {f"{EFFORT}/{name}": angles[layout.joints[0]] for name in layout.motors}
    return told
