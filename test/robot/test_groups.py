"""Groups of cables that depend on each other, and robot files of one group."""

from dataclasses import replace

import numpy as np
import pytest
from support.fingers import WRIST, cable, finger, hand
from support.places import ROBOTS

from cdrj_ros.robot.groups import channels_of, connected_cables, joints_of, part_of
from cdrj_ros.robot.reader import build_robot, load_robot


def test_fingers_that_share_nothing_are_groups_and_their_own_cables_are_one():
    assert connected_cables(hand(finger("a"), finger("b", cables=3))) == ((0, 1), (2, 3, 4))


def test_a_cable_depends_on_the_joints_that_carry_its_nodes():
    robot = hand(finger("a", "palm"), **WRIST)
    assert joints_of(robot, robot.cables[0]) == {"a_mcp", "a_pip", "wrist"}
    assert joints_of(robot, robot.cables[1]) == {"a_mcp", "wrist"}


def test_a_wrist_connects_the_fingers_but_for_its_branches():
    robot = hand(finger("a", "palm"), finger("b", "palm"), **WRIST)
    assert connected_cables(robot) == ((0, 1, 2, 3),)
    assert connected_cables(robot, branches=True) == ((0, 1), (2, 3))


def test_cables_of_the_wrist_itself_are_a_branch_of_their_own():
    own = {"motors": [{"name": "m"}], "cables": [cable("w", "m", "palm", 0)]}
    robot = hand({**WRIST, **own}, finger("a", "palm"), finger("b", "palm"))
    assert connected_cables(robot, branches=True) == ((0,), (1, 2), (3, 4))


def test_a_motor_that_winds_cables_of_two_fingers_connects_them():
    left, right = finger("a"), finger("b")
    right["cables"][0]["nodes"][0]["motor"] = "a_motor0"
    assert connected_cables(hand(left, right), branches=True) == ((0, 1, 2, 3),)


def test_a_joint_without_encoder_connects_all_branches_beyond_it():
    joint = {**WRIST["joints"][0], "measured": False}
    robot = hand(finger("a", "palm"), finger("b", "palm"), frames=WRIST["frames"], joints=[joint])
    assert connected_cables(robot, branches=True) == ((0, 1, 2, 3),)


@pytest.mark.parametrize("name", ["prototype", "finger", "finger3d", "wrist", "cdpr"])
def test_a_shipped_robot_is_one_group_whose_part_is_the_file(name):
    robot = load_robot(ROBOTS / f"{name}.yaml")
    everything = tuple(range(len(robot.cables)))
    assert connected_cables(robot) == (everything,)
    assert part_of(robot, everything) == robot.document


def test_a_part_is_the_robot_that_was_written_alone():
    both, alone = hand(finger("a"), finger("b")), hand(finger("b"))
    part = build_robot(part_of(both, (2, 3)), both.source)
    assert replace(part, uncertainty=None) == replace(alone, uncertainty=None)
    assert part.uncertainty.parameters == alone.uncertainty.parameters
    np.testing.assert_array_equal(part.uncertainty.covariance, alone.uncertainty.covariance)


def test_a_part_keeps_what_is_known_of_its_own_numbers():
    both = hand(finger("a"), finger("b"))
    document = {
        **both.document,
        "uncertainty": {
            "drums": {"a_0": "may_slip", "b_1": "hold"},
            "parameters": ["cables.a_0.preload", "cables.b_0.preload", "friction.mu_c"],
            "stddev": [0.1, 0.2, 0.03],
            "correlation": [[1.0, 0.3, 0.0], [0.3, 1.0, -0.5], [0.0, -0.5, 1.0]],
            "model_error": {"effort/a_motor0": 0.1, "effort/b_mcp": 0.2, "tension/b_0/2": 0.3},
        },
    }
    entry = part_of(build_robot(document, "file"), (2, 3))["uncertainty"]
    assert entry["drums"] == {"b_1": "hold"}
    assert entry["parameters"] == ["cables.b_0.preload", "friction.mu_c"]
    np.testing.assert_allclose(entry["stddev"], [0.2, 0.03])
    np.testing.assert_allclose(entry["correlation"], [[1.0, -0.5], [-0.5, 1.0]])
    assert entry["model_error"] == {"effort/b_mcp": 0.2, "tension/b_0/2": 0.3}


def test_efforts_of_a_joint_that_other_cables_move_are_of_no_group():
    robot = hand(finger("a", "palm"), finger("b", "palm"), **WRIST)
    efforts = {name for name in channels_of(robot, (0, 1)) if name.startswith("effort/")}
    assert efforts == {"effort/a_motor0", "effort/a_motor1", "effort/a_mcp", "effort/a_pip"}
