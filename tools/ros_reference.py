"""Print docs/ros_reference.md: topics, quality of service, services and parameters of every node.

    python tools/ros_reference.py > docs/ros_reference.md

The nodes are started in this process with everything that is on request, and describe themselves.
"""

import os

import rclpy
from rclpy.parameter import Parameter

from cdrj_ros.messages.topics import NAMESPACE

HEAD = """\
# Topics, services and parameters of the nodes

This page lists the topics, services and parameters of every node. Names are relative to the
namespace `/cdrj`, and `~` is the node's own name. Topics are reliable and volatile, with the given
depth, unless the table says otherwise; `estimator` also accepts best-effort publishers.
`ros2 param describe /cdrj/estimator timeout` and `ros2 interface show cdrj_msgs/msg/CableTensions`
print the same descriptions. `python tools/ros_reference.py` prints this page.
"""

NOTES = {
    "estimator": "Some topics and services exist only on request:\n\n"
    "- `wrenches` for their subscribers;\n"
    "- `joint_angles` and `joint_angles_stddev` for [joints without "
    "encoder](robot_file.md#joints-without-encoder);\n"
    "- with `--managed` the services of the "
    "[lifecycle](install.md#the-estimator-as-a-lifecycle-node)\n  and `~/transition_event`;\n"
    "- the input `/clock` with `use_sim_time`.\n\n"
    "Parameters `qos_overrides.<topic>.<publisher or subscription>.<policy>` override the QoS of "
    "every topic.\nWith `--managed`, parameters that do not change while running may change while "
    "unconfigured.",
    "rig": "Described in [Simulated robot](simulation.md#the-robot-as-a-node).",
    "replay": "Options are on its command line: "
    "[Replay](recordings.md#replay-through-the-running-node).",
    "watch": "Options are on its command line: [Live table](view.md#terminal).",
    "markers": "Described in [RViz](view.md#rviz).",
    "view": "Described in [Browser](view.md#browser). It needs the extra `view`. While a page is "
    "open, it subscribes to `tensions`, `nodal_forces`, `joint_states`, `references` and "
    "`/diagnostics`.",
}

OWN = ("/rosout", "/parameter_events")
PARAMETER_SERVICES = (
    "describe_parameters", "get_parameter_types", "get_parameters", "list_parameters",
    "set_parameters", "set_parameters_atomically", "get_type_description",
)  # fmt: skip
LIFECYCLE = "lifecycle_msgs/"


def _overrides(**given):
    return [Parameter(name, value=value) for name, value in given.items()]


def _nodes():
    """Start every node with all its topics; yields name and node."""
    from cdrj_ros.nodes.estimator import ManagedEstimator
    from cdrj_ros.nodes.markers import MarkersNode
    from cdrj_ros.nodes.replay_node import ReplayNode
    from cdrj_ros.nodes.rig import RigNode
    from cdrj_ros.nodes.view import ViewNode
    from cdrj_ros.nodes.watch import WatchNode
    from cdrj_ros.recordings.recording import Topics

    estimator = ManagedEstimator(parameter_overrides=_overrides(robot="prototype"))
    estimator.trigger_configure()
    estimator.trigger_activate()
    yield "estimator", estimator
    rig = RigNode(
        parameter_overrides=_overrides(
            robot="prototype", cells=1, truth_rate=1.0, drive_clock=True, rig="load_cells"
        )
    )
    yield "rig", rig
    yield "replay", ReplayNode(Topics(), clock_hz=10.0)
    yield "watch", WatchNode()
    markers = MarkersNode(parameter_overrides=_overrides(robot="prototype"))
    markers.inputs.listen(True)
    yield "markers", markers
    view = ViewNode(parameter_overrides=_overrides(robot="prototype", port=0))
    view.page.close()
    yield "view", view


def _table(head, rows):
    lines = [f"| {' | '.join(head)} |", f"|{'---|' * len(head)}"]
    lines += [f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |" for row in rows]
    return "\n".join(lines) + "\n"


def _short(name, node):
    """A name relative to the namespace, with ~ for the node's own."""
    own = f"/{NAMESPACE}/{node.get_name()}/"
    if name.startswith(own):
        return "~/" + name.removeprefix(own)
    return name.removeprefix(f"/{NAMESPACE}/")


def _type(message):
    package, _, _ = message.__module__.partition(".")
    return f"{package}/{message.__name__}"


def _quality(profile):
    words = [str(profile.depth)]
    if profile.reliability.name == "BEST_EFFORT":
        words.append("best effort")
    if profile.durability.name == "TRANSIENT_LOCAL":
        words.append("transient local")
    return ", ".join(words)


def _topics(node):
    rows = {}
    for way, ends in (("in", node.subscriptions), ("out", node.publishers)):
        for end in ends:
            topic = end.topic_name if way == "in" else end.topic
            name = _short(topic, node)
            if topic not in OWN:
                quality = _quality(end.qos_profile)
                rows[way, name] = (way, f"`{name}`", _type(end.msg_type), quality)
    if node.get_name() == "estimator":  # opened for its first subscriber
        kind = "geometry_msgs/WrenchStamped"
        rows[()] = ("out", "`wrenches/<cable>_<node>`", kind, "1000")
    return list(rows.values())


def _services(node):
    return [
        (f"`{name}`", kind)
        for service in node.services
        if (name := _short(service.srv_name, node)).rpartition("/")[2] not in PARAMETER_SERVICES
        and not (kind := _type(service.srv_type)).startswith(LIFECYCLE)
    ]


def _parameters(settings, known):
    """Rows of parameters; what another node has described is not said again."""
    rows = []
    for one in settings:
        default, descriptor = one.default, one.descriptor()
        kind = default.name.lower() if isinstance(default, Parameter.Type) else ""
        words = ", ".join(default) if isinstance(default, tuple) else repr(default)
        shown = kind.replace("_", " ") or words.replace("'", "").lower() or "empty"
        for each in (*descriptor.floating_point_range, *descriptor.integer_range):
            shown += f" ({each.from_value:g} to {each.to_value:g})"
        when = "" if descriptor.read_only else " May change while running."
        text = descriptor.description + ("" if descriptor.description[-1] == "." else ".") + when
        first = known.setdefault((one.name, text), descriptor)
        rows.append((f"`{one.name}`", shown, text if first is descriptor else "As above."))
    return rows


def page():
    """Return the page."""
    from cdrj_ros.nodes import markers, rig_settings, view
    from cdrj_ros.nodes.parameters import settings

    tables = {
        "estimator": settings(),
        "rig": rig_settings.SETTINGS,
        "markers": markers.SETTINGS,
        "view": view.SETTINGS,
    }
    parts, started, known = [HEAD], [], {}
    try:
        for name, node in _nodes():
            started.append(node)
            parts += [f"## {name}\n", NOTES[name] + "\n"]
            if topics := _topics(node):
                parts.append(_table(("", "topic", "type", "depth"), topics))
            if services := _services(node):
                parts.append(_table(("service", "type"), services))
            if parameters := _parameters(tables.get(name, ()), known):
                parts.append(_table(("parameter", "default", ""), parameters))
    finally:
        for node in started:
            node.destroy_node()
    return "\n".join(parts)


def main():
    """Print the page."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    rclpy.init()
    try:
        print(page(), end="")
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
