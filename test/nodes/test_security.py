"""Security: the policy file matches the ROS graph, and no node can be made to write a file."""

import ast
import os
from fnmatch import fnmatch
from unittest.mock import MagicMock
from xml.etree import ElementTree

import pytest
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.parameter import Parameter
from support.places import ROBOT, ROOT
from visualization_msgs.msg import MarkerArray

from cdrj_ros.nodes.estimator import ManagedEstimator
from cdrj_ros.nodes.markers import MarkersNode
from cdrj_ros.nodes.replay_node import ReplayNode
from cdrj_ros.nodes.rig import RigNode
from cdrj_ros.nodes.robot_description import listener_of
from cdrj_ros.nodes.settings import RANGE
from cdrj_ros.nodes.spinning import REACH, ros_context, stay_on_this_machine
from cdrj_ros.nodes.watch import WatchNode
from cdrj_ros.recordings.recording import Topics

PACKAGE = ROOT / "cdrj_ros"
POLICY = ROOT / "config" / "sros2" / "cdrj_ros.policy.xml"

GRAPH = {
    ("topics", "publish"): "get_publisher_names_and_types_by_node",
    ("topics", "subscribe"): "get_subscriber_names_and_types_by_node",
    ("services", "reply"): "get_service_names_and_types_by_node",
    ("services", "request"): "get_client_names_and_types_by_node",
}


ELSEWHERE = {"/cdrj/joint_angles", "/cdrj/joint_angles_stddev"}
"""Topics that only robots with joints without encoder have."""


def allowed(node):
    """Full names that the policy allows a node, by kind and permission."""
    (profile,) = (p for p in ElementTree.parse(POLICY).iter("profile") if p.get("node") == node)
    namespace = profile.get("ns")
    names = {key: set() for key in GRAPH}
    for group in profile:
        for rule, verdict in group.attrib.items():
            assert verdict == "ALLOW"
            for entry in group:
                name = (entry.text or "").strip()
                if name.startswith("~/"):
                    name = f"{namespace}/{node}/{name[2:]}"
                elif not name.startswith("/"):
                    name = f"{namespace}/{name}"
                names[group.tag, rule].add(name)
    return names


def shortened(real, allowed):
    """The real names, those that an allowed pattern covers replaced by the pattern."""
    return {
        key: {
            next((one for one in allowed[key] if "*" in one and fnmatch(name, one)), name)
            for name in names
        }
        for key, names in real.items()
    }


@pytest.fixture
def nodes(bench):
    """One node of each executable with all their topics."""
    given = {"robot": ROBOT, "use_sim_time": True}
    estimator = ManagedEstimator(parameter_overrides=parameters(given))
    estimator.trigger_configure()
    estimator.trigger_activate()
    clock = parameters({"use_sim_time": True})
    watch = WatchNode(parameter_overrides=clock)
    given = {"robot": ROBOT, "cells": 1, "truth_rate": 1.0, "drive_clock": True}
    rig = RigNode(parameter_overrides=parameters({**given, "rig": "load_cells"}))
    markers = MarkersNode(parameter_overrides=parameters({"robot": ROBOT}))
    bench.listen(WrenchStamped, "/cdrj/wrenches/upper_3")
    bench.listen(MarkerArray, "/cdrj/markers")
    listeners = [listener_of(node, MagicMock()) for node in (estimator, rig, markers)]
    replay = ReplayNode(Topics(), clock_hz=10.0)
    for node in (estimator, replay, watch, rig, markers, *listeners):
        bench.add(node)
    return bench


def parameters(given):
    return [Parameter(name, value=value) for name, value in given.items()]


@pytest.fixture
def view(nodes):
    """The view as while a browser shows its page, and its listener to the robot's URDF."""
    pytest.importorskip("viser")
    from cdrj_ros.nodes.view import ViewNode

    node = ViewNode(parameter_overrides=parameters({"robot": ROBOT, "port": 0}))
    listener = listener_of(node, MagicMock())
    node.listen(True)
    yield node
    node.page.close()
    for one in (listener, node):
        one.destroy_node()


def compare(nodes, names):
    """Compare the policy with the graph of the nodes of these names."""

    def graph(node):
        return {
            key: {name for name, _ in getattr(nodes.node, method)(node, "/cdrj")}
            for key, method in GRAPH.items()
        }

    for node in names:
        wanted = {key: given - ELSEWHERE for key, given in allowed(node).items()}
        nodes.until(lambda: wanted == shortened(graph(node), wanted), 10.0)  # noqa: B023
        real = shortened(graph(node), wanted)
        for key, allowed_names in wanted.items():
            assert real[key] == allowed_names, (node, *key)


def test_the_policy_allows_exactly_what_the_nodes_have(nodes):
    told = [f"{node}_robot_description" for node in ("estimator", "rig", "markers")]
    compare(nodes, ["estimator", "replay", "watch", "rig", "markers", *told])


def test_the_policy_allows_exactly_what_the_view_has(nodes, view):
    compare(nodes, ["view", "view_robot_description"])


def calls(path):
    """Names of the functions and methods that a module calls."""
    nodes = ast.walk(ast.parse(path.read_text("utf-8")))
    functions = [node.func for node in nodes if isinstance(node, ast.Call)]
    return {getattr(one, "attr", getattr(one, "id", "")) for one in functions}


WRITING = {
    "open", "write_text", "write_bytes", "mkdir", "makedirs", "unlink", "rename", "rmdir", "touch",
    "symlink_to", "chmod", "mkstemp", "mkdtemp", "save", "savez", "savez_compressed", "savetxt",
    "tofile", "dump", "system", "popen", "Popen", "check_call", "check_output", "rmtree",
}  # fmt: skip


def test_a_node_writes_no_file_itself():
    for path in (PACKAGE / "nodes").glob("*.py"):
        assert not WRITING & calls(path), path


def test_a_node_communicates_on_this_machine_only_unless_the_environment_differs():
    environment = {"PATH": "/bin", "ROS_STATIC_PEERS": ""}
    assert stay_on_this_machine(environment)
    assert environment[RANGE] == "LOCALHOST"
    for name in REACH:
        told = {name: "SUBNET"}
        assert not stay_on_this_machine(told)
        assert told == {name: "SUBNET"}


def test_ros_uses_the_default_discovery_range(monkeypatch):
    for name in REACH:
        monkeypatch.delenv(name, raising=False)
    with ros_context(["x"]):
        assert (os.environ[RANGE], rclpy.ok()) == ("LOCALHOST", True)


def test_the_policy_is_of_the_form_that_sros2_reads():
    policy = ElementTree.parse(POLICY).getroot()
    assert (policy.tag, policy.attrib) == ("policy", {"version": "0.2.0"})
    enclaves = policy.findall("./enclaves/enclave")
    assert {e.get("path") for e in enclaves} == {
        f"/cdrj/{node}" for node in ("estimator", "replay", "watch", "rig", "markers", "view")
    }
    for profile in policy.iter("profile"):
        for group in profile:
            single = group.tag.removesuffix("s")
            rules = {"topics": {"publish", "subscribe"}, "services": {"reply", "request"}}
            assert set(group.attrib) <= rules[group.tag]
            assert len(group) > 0
            assert all(entry.tag == single and entry.text for entry in group)
