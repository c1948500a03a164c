"""config/robots/hand.yaml: what its comments state, and the variant without encoders."""

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.inspection.motors import determined_joints
from cdrj_ros.model.prepared import load_model, prepare, shape_at
from cdrj_ros.robot.reader import parse_robot

FINGERS = ("index", "middle", "ring", "little", "thumb")
PAIRS = (("abductor", "adductor"), ("mcp_flexor", "mcp_extensor"), ("pip_flexor", "pip_extensor"))
ARM = {"side": 0.007, "mcp": 0.008, "pip": 0.006}


@pytest.fixture(scope="module")
def hand():
    return load_model("hand")


def poses(model, count):
    joints = model.robot.joints
    lower, upper = (np.array([getattr(one, end) for one in joints]) for end in ("lower", "upper"))
    shares = np.random.default_rng(4).random((count, len(joints)))
    return list(lower + shares * (upper - lower))


def lengths(model, pose):
    length = shape_at(model, pose).length
    return {
        cable.name: float(length[part].sum())
        for cable, part in zip(model.robot.cables, model.robot.parts, strict=True)
    }


def test_the_two_cables_of_a_motor_change_by_opposite_lengths_in_all_poses(hand):
    rest = lengths(hand, hand.robot.reference_pose)
    for pose in poses(hand, 20):
        now = lengths(hand, pose)
        for finger in FINGERS:
            for one, other in PAIRS:
                names = f"{finger}_{one}", f"{finger}_{other}"
                grown, shrunk = (now[name] - rest[name] for name in names)
                assert abs(grown + shrunk) < 1e-4
                assert abs(grown) < 0.02


def test_a_joint_of_a_finger_moves_its_own_two_cables_alone(hand):
    joints = [joint.name for joint in hand.robot.joints]
    for pose in poses(hand, 5):
        for finger in FINGERS:
            for joint, arm in ARM.items():
                moved = pose.copy()
                moved[joints.index(f"{finger}_{joint}")] += 1e-4
                before, after = lengths(hand, pose), lengths(hand, moved)
                own = [f"{finger}_{name}" for name in PAIRS[list(ARM).index(joint)]]
                for name in before:
                    slope = (before[name] - after[name]) / 1e-4
                    sign = {own[0]: 1.0, own[1]: -1.0}.get(name, 0.0)
                    # the cables of pip pass 1.5 mm beside the axis of side, which moves them
                    beside = 1.6e-3 if joint == "side" and "pip" in name and finger in name else 0
                    assert slope == pytest.approx(sign * arm, abs=beside + 1e-5)


def test_the_efforts_tell_the_angles_of_a_hand_without_encoders_at_the_distal_joints():
    text = (ROBOTS / "hand.yaml").read_text(encoding="utf-8")
    blind = text.replace("measured: true", "measured: false")
    model = prepare(parse_robot(blind))
    found = determined_joints(model)
    assert list(found) == [f"{finger}_pip" for finger in FINGERS]
    assert max(found.values()) < np.radians(1.0)
