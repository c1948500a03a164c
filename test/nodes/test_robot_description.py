"""A robot file that names robot_description takes its frames from the topic or the parameter."""

import threading

import pytest
from rclpy.parameter import Parameter
from std_msgs.msg import String
from support.places import ROBOTS

from cdrj_ros.foundation.errors import RobotFileError, UsageError
from cdrj_ros.nodes.robot_description import KEPT, robot_description
from cdrj_ros.robot.names import given
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.robot.urdf import PUBLISHED

URDF = (ROBOTS / "finger3d.urdf").read_text(encoding="utf-8")


@pytest.fixture
def robot_file(tmp_path):
    path = tmp_path / "finger.yaml"
    text = (ROBOTS / "finger3d.yaml").read_text(encoding="utf-8")
    path.write_text(text.replace("urdf: finger3d.urdf", "urdf: robot_description"))
    return path


def test_the_frames_are_those_of_the_description(robot_file):
    with given(PUBLISHED, lambda: URDF):
        told = load_robot(robot_file)
    assert told.frames == load_robot(ROBOTS / "finger3d.yaml").frames


def test_without_a_node_one_line_says_where_to_get_it(robot_file):
    with pytest.raises(RobotFileError, match="known to nodes only; save it by ros2 param get"):
        load_robot(robot_file)


def test_the_topic_of_robot_state_publisher_is_heard(node):
    node.create_publisher(String, "/robot_description", KEPT).publish(String(data=URDF))
    assert robot_description(node, wait_s=60.0) == URDF


def test_the_parameter_comes_before_the_topic(node):
    node.declare_parameter("robot_description", URDF)
    assert robot_description(node, wait_s=0.0) == URDF


def test_silence_is_one_clear_line(node):
    with pytest.raises(UsageError, match=r"no URDF on /robot_description within 0\.1 s"):
        robot_description(node, wait_s=0.1)


RIG = {"payload": 0.01}
"""A load that the finger holds."""


def make(name, given):
    """A node by the name of its executable, and the joints of its robot."""
    options = [Parameter(key, value=value) for key, value in given.items()]
    if name == "estimator":
        from cdrj_ros.nodes.estimator import EstimatorNode

        estimator = EstimatorNode(parameter_overrides=options)
        return estimator, estimator.estimation.live.model.layout.joints
    if name == "rig":
        from cdrj_ros.nodes.rig import RigNode

        options += [Parameter(key, value=value) for key, value in RIG.items()]
        rig = RigNode(parameter_overrides=options)
        return rig, tuple(joint.name for joint in rig.rig.robot.joints)
    if name == "markers":
        from cdrj_ros.nodes.markers import MarkersNode

        markers = MarkersNode(parameter_overrides=options)
        return markers, markers.model.layout.joints
    pytest.importorskip("viser")
    from cdrj_ros.nodes.view import ViewNode

    view = ViewNode(parameter_overrides=[*options, Parameter("port", value=0)])
    view.page.close()
    return view, view.model.layout.joints


@pytest.mark.parametrize("name", ["estimator", "markers", "view", "rig"])
def test_every_node_of_a_robot_takes_the_description_of_the_topic(name, node, robot_file):
    publisher = node.create_publisher(String, "/robot_description", KEPT)
    sooner = threading.Timer(0.2, lambda: publisher.publish(String(data=URDF)))
    sooner.start()
    made, joints = make(name, {"robot": str(robot_file)})
    made.destroy_node()
    sooner.join()
    assert joints == ("abduction", "mcp", "pip")
