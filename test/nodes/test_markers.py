"""The markers node draws what the estimator says, and nothing while nobody subscribes."""

from time import monotonic

import numpy as np
import pytest
from cdrj_msgs.msg import CableTensions, NodalForces
from cdrj_msgs.msg import CableTensions as T
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from cdrj_ros.nodes.markers import MarkersNode
from cdrj_ros.view.picture import picture_of


@pytest.fixture
def drawing(ros):
    """Create a markers node in this process."""
    opened = []

    def create(**parameters):
        given = {"robot": "finger", **parameters}
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        opened.append(MarkersNode(parameter_overrides=overrides))
        return opened[-1]

    yield create
    for one in opened:
        one.destroy_node()


def hear(node, topic, message):
    """The markers after a message, by namespace and number."""
    node.inputs.hear(topic, serialize_message(message))
    return markers_of(node)


def markers_of(node):
    return {f"{marker.ns}/{marker.id}": marker for marker in node.picture().markers}


def colour(marker):
    return marker.color.r, marker.color.g, marker.color.b


def test_a_marker_has_the_looks_that_the_picture_gives_it(drawing, monkeypatch):
    from cdrj_ros.nodes import feed, view_inputs

    node = drawing(labels=True, force_scale=0.001)
    names, pulley = list(node.model.layout.elements), node.model.layout.pulleys[0]
    rest = [1.0] * (len(names) - 4)
    tension, status = [18.0, 0.0, 9.0, 150.0, *rest], [0, T.SLACK, T.UNSURE, T.INVALID]
    hear(node, "tensions", T(name=names, tension=tension, status=[*status, *[0] * len(rest)]))
    assert markers_of(node)["forces/1"].action == Marker.DELETE
    message = NodalForces(
        name=[pulley], force_x=[10.0], force_y=[0.0], force_z=[0.0], magnitude=[10.0],
        friction=[0.0], slip_speed=[0.01], status=[0],
    )  # fmt: skip
    drawn = hear(node, "nodal_forces", message)
    picture = picture_of(node.model, node.inputs.snapshot(), force_scale=0.001)
    for k, look in enumerate(picture.cables):
        marker = drawn[f"cables/{k}"]
        assert marker.type == (Marker.LINE_LIST if look.dashed else Marker.LINE_STRIP)
        assert (marker.scale.x, marker.color.a) == pytest.approx((look.width, look.opacity))
        assert colour(marker) == pytest.approx(look.colour)
        assert drawn[f"labels/{k}"].text == look.label
    for k, body in enumerate(picture.bodies):
        assert colour(drawn[f"bodies/{k}"]) == pytest.approx(body.colour)
    start, end = drawn["forces/1"].points
    assert (end.x - start.x, end.y - start.y) == pytest.approx((0.01, 0.0))
    later = monotonic() + view_inputs.SILENCE_S + 0.1
    monkeypatch.setattr(feed, "monotonic", lambda: later)
    old = [marker.type for marker in node.picture().markers if marker.ns == "cables"]
    assert old == [Marker.LINE_LIST] * len(names)


@pytest.mark.parametrize("robot", ["finger", "wrist"])
def test_bodies_have_their_shape_size_and_axis_and_links_end_at_the_joints(drawing, robot):
    from scipy.spatial.transform import Rotation

    from cdrj_ros.report.scene import scene_of

    node = drawing(robot=robot)
    model, drawn = node.model, markers_of(node)
    scene = scene_of(model, model.robot.reference_pose)

    def along(marker):
        turned = marker.pose.orientation
        return Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]).apply([0.0, 0.0, 1.0])

    round_ones = 0
    for k, body in enumerate(scene.bodies):
        marker = drawn[f"bodies/{k}"]
        flat = body.shape in ("disc", "cylinder")
        assert marker.type == (Marker.CYLINDER if flat else Marker.SPHERE)
        np.testing.assert_allclose(along(marker), body.axis, atol=1e-9)
        if body.radius > 0.002:
            round_ones += 1
            assert marker.scale.x == marker.scale.y == pytest.approx(2.0 * body.radius)
    assert round_ones >= 3
    assert scene.links
    for k, (start, end) in enumerate(scene.links):
        marker = drawn[f"links/{k}"]
        middle = marker.pose.position
        half = 0.5 * marker.scale.z * along(marker)
        np.testing.assert_allclose(
            np.array([middle.x, middle.y, middle.z]) - half, start, atol=1e-9
        )
        np.testing.assert_allclose(np.array([middle.x, middle.y, middle.z]) + half, end, atol=1e-9)


def test_nothing_is_heard_or_drawn_without_a_subscriber(bench):
    node = bench.add(MarkersNode(parameter_overrides=[Parameter("robot", value="finger")]))
    publisher = bench.node.create_publisher(CableTensions, "/cdrj/tensions", 1)
    names = list(node.model.layout.elements)
    message = CableTensions(name=names, tension=[9.0] * len(names), status=[0] * len(names))

    def holds(condition):
        publisher.publish(message)
        return condition()

    ticks = iter(range(20))
    assert bench.until(lambda: holds(lambda: next(ticks) == 19))
    assert (node.drawn, node.inputs.count) == (0, 0)
    assert publisher.get_subscription_count() == 0
    got = []
    listener = bench.node.create_subscription(MarkerArray, "/cdrj/markers", got.append, 1)
    assert bench.until(
        lambda: holds(lambda: bool(got) and got[-1].markers[0].type != got[0].markers[0].type)
    )
    assert node.inputs.count > 0
    bench.node.destroy_subscription(listener)
    assert bench.until(lambda: holds(lambda: publisher.get_subscription_count() == 0))
    assert not node.inputs.listening


def test_shapes_of_bodies_are_markers_of_their_size_and_place(drawing, tmp_path):
    (tmp_path / "part.stl").write_bytes(bytes(84))
    robot = tmp_path / "robot.yaml"
    robot.write_text("""
name: arm
motors: []
joints: [{name: q, range: [-1, 1]}]
base_link: arm/base_link
frames: [{name: upper, motion: revolute, joint: q, origin: [0, 0, 0.2]}]
visuals:
  - {frame: upper, box: [0.2, 0.03, 0.04], origin: [0.1, 0, 0], rpy: [0, 0, 3.141592653589793]}
  - {cylinder: [0.02, 0.1]}
  - {sphere: 0.03}
  - {mesh: part.stl, scale: [0.001, 0.001, 0.001]}
cables:
  - name: c
    axial_stiffness: 1e4
    preload: 10
    nodes:
      - {type: anchor, position: [0.3, 0, 0]}
      - {type: anchor, position: [0.1, 0, 0], frame: upper}
""")
    drawn = markers_of(drawing(robot=str(robot)))
    box, cylinder, sphere, mesh = (drawn[f"visuals/{k}"] for k in range(4))
    kinds = (Marker.CUBE, Marker.CYLINDER, Marker.SPHERE, Marker.MESH_RESOURCE)
    assert tuple(one.type for one in (box, cylinder, sphere, mesh)) == kinds
    assert (box.pose.position.x, box.pose.position.z) == (0.1, 0.2)
    assert abs(box.pose.orientation.z) == pytest.approx(1.0)
    sizes = [(one.scale.x, one.scale.y, one.scale.z) for one in (box, cylinder, sphere, mesh)]
    assert sizes == [(0.2, 0.03, 0.04), (0.04, 0.04, 0.1), (0.06, 0.06, 0.06), (1e-3, 1e-3, 1e-3)]
    assert mesh.mesh_resource == (tmp_path / "part.stl").as_uri()
    assert {one.header.frame_id for one in drawn.values()} == {"arm/base_link"}
    assert not any(name.startswith("links/") for name in drawn)
