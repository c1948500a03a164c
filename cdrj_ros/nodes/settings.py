"""What users set of nodes: parameters as tables, and the quality of service of topics.

There is one tuple of ``Setting`` per node.  From such a table follow the declaration, the values
read at the start, the parameter file and the page docs/ros_reference.md.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import wrap
from typing import Any, Final

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from cdrj_ros.foundation.errors import UsageError, nearest
from cdrj_ros.messages.topics import TRUTH

WIDTH: Final = 96
"""Maximum line length of comments in a parameter file [columns]."""

OF_ROS: Final = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""How names of the parameters begin that ROS itself gives every node."""


@dataclass(frozen=True)
class Setting:
    """One parameter."""

    name: str
    default: bool | int | float | str | tuple[str, ...] | Parameter.Type
    """The default, which also gives the type; or the type of a parameter without default."""
    description: str
    unit: str = ""
    low: float = 0.0
    high: float = 0.0
    """Range of a number, both ends included."""
    choices: tuple[str, ...] = ()
    """Allowed values of a text; empty if any text is allowed."""
    changeable: bool = False
    """Whether it may be set while the node runs."""

    @property
    def bounded(self) -> bool:
        """Whether the parameter is a number with a range."""
        return isinstance(self.default, int | float) and not isinstance(self.default, bool)

    @property
    def text(self) -> str:
        """The description with the choices and the unit."""
        choices = f" ({' or '.join(self.choices)})" if self.choices else ""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.description}{choices}{unit}"

    def descriptor(self, *, fixed: bool = True) -> ParameterDescriptor:
        """What ROS is told; ``fixed``: a parameter that is not changeable is read-only."""
        descriptor = ParameterDescriptor(
            description=self.text, read_only=fixed and not self.changeable
        )
        if isinstance(self.default, float):
            limits = FloatingPointRange(from_value=self.low, to_value=self.high)
            descriptor.floating_point_range = [limits]
        elif self.bounded:
            whole = IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)
            descriptor.integer_range = [whole]
        return descriptor


def declare(node: Node, settings: Sequence[Setting], *, fixed: bool = True) -> None:
    """Declare every parameter of a table; integers are given for doubles, too: 1 means 1.0.

    Args:
        node: the node.
        settings: the table.
        fixed: whether those that are not changeable are read-only for ROS.

    Raises:
        ParameterException: a given value has another type, or is out of range.
    """
    for one in settings:
        default = list(one.default) if isinstance(one.default, tuple) else one.default
        descriptor = one.descriptor(fixed=fixed)
        try:
            node.declare_parameter(one.name, default, descriptor)
        except InvalidParameterTypeException:
            given = given_parameter(node, one.name)
            double = as_double(given, default)
            if double is given:
                raise
            node.declare_parameter(one.name, double.value, descriptor, ignore_override=True)


def values_of(node: Node, settings: Sequence[Setting]) -> dict[str, Any]:
    """The present value of every parameter by name; None if an array is not set.

    Raises:
        UsageError: a text is none of its choices; ROS itself checks types and ranges.
    """
    values = {one.name: node.get_parameter_or(one.name).value for one in settings}
    for one in settings:
        if one.choices and values[one.name] not in one.choices:
            raise UsageError(
                f"{one.name} must be one of {', '.join(one.choices)}, got {values[one.name]!r}"
            )
    return values


def given_parameter(node: Node, name: str) -> Parameter:
    """A parameter that is not declared, as given at the start; of type NOT_SET if it was not."""
    given = node.declare_parameter(name, None, ParameterDescriptor(dynamic_typing=True))
    node.undeclare_parameter(name)
    return given


def as_double(given: Parameter, kind: Any) -> Parameter:
    """The parameter with integers converted to doubles, if its default or type is of doubles."""
    if isinstance(kind, float) and given.type_ == Parameter.Type.INTEGER:
        return Parameter(given.name, value=float(given.value))
    if kind == Parameter.Type.DOUBLE_ARRAY and given.type_ == Parameter.Type.INTEGER_ARRAY:
        return Parameter(given.name, value=[float(value) for value in given.value])
    return given


def refuse_unknown_parameters(arguments: Sequence[str], settings: Sequence[Setting]) -> None:
    """Refuse names on the command line that no parameter has; rclpy would ignore a misspelt one.

    Names in a parameter file may be those of other nodes.

    Args:
        arguments: the command line of one node.
        settings: its table.

    Raises:
        UsageError: an unknown name; the message suggests the nearest known one.
    """
    known = [one.name for one in settings]
    for flag, rule in pairwise(arguments):
        name, assigned, _ = rule.partition(":=")
        of_this_node = flag in ("-p", "--param") and assigned and ":" not in name
        if of_this_node and name not in known and not name.startswith(OF_ROS):
            raise UsageError(f"there is no parameter {name}; {nearest(name, known)}")


_HEADER: Final = """\
# Parameters of the node {name} at their defaults. Copy this file, edit the copy and start with
#
#   ros2 run cdrj_ros {name} --ros-args --params-file my.params.yaml
{usage}#
# Written by `ros2 run cdrj_ros {name} --print-parameters`.{remarks}
/**/{name}:
  ros__parameters:
"""


def parameter_file(
    name: str, settings: Sequence[Setting], *, usage: str = "", remarks: str = ""
) -> str:
    """Every parameter of a node at its default, with description, unit and range (YAML).

    Args:
        name: of the node.
        settings: its table.
        usage: further lines that start the node, as comments.
        remarks: further comments.
    """
    lines = []
    inside = ""
    for one in settings:
        group, _, key = one.name.rpartition(".")
        if group != inside:
            lines.append(f"    {group}:")
            inside = group
        indent = "      " if group else "    "
        limits = f" Range {one.low:g} to {one.high:g}." if one.bounded else ""
        when = "May change while running." if one.changeable else "Read-only."
        comment = f"{one.text.rstrip('.')}.{limits} {when}"
        lines += [f"{indent}# {line}" for line in wrap(comment, WIDTH - len(indent))]
        if isinstance(one.default, Parameter.Type):
            lines.append(f"{indent}# {key}: []")
        else:
            lines.append(f"{indent}{key}: {_yaml(one.default)}")
    header = _HEADER.format(name=name, usage=usage, remarks=remarks)
    return header + "\n".join(lines) + "\n"


def _yaml(value: bool | int | float | str | tuple[str, ...]) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(_yaml, value))}]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


DEPTH: Final = 1000
"""Queue depth of a topic [messages]."""


def default_profile() -> QoSProfile:
    """A reliable profile whose queue holds all messages in flight."""
    return QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.RELIABLE)


RANGE: Final = "ROS_AUTOMATIC_DISCOVERY_RANGE"
"""Variable of the environment: which computers a node hears."""


def remapping(node: Node, name: str, msgtype: str) -> str:
    """The remapping to another topic of the same type that has publishers, or where none was found.

    The truth of a simulated rig is none: no robot publishes it.

    Args:
        node: the node without a publisher on its topic; what it publishes itself is no other topic.
        name: of that topic, before it was resolved.
        msgtype: ``sensor_msgs/msg/JointState``.
    """
    topic = node.resolve_topic_name(name)
    others = [one for one, types in node.get_topic_names_and_types() if msgtype in types]
    for other in sorted(others, key=lambda one: not f"/{name}".endswith(one[one.rindex("/") :])):
        there = {one.node_name for one in node.get_publishers_info_by_topic(other)}
        asked = node.resolve_topic_name(other) == other  # rclpy asks for what it is remapped to
        elsewhere = not asked or (other != topic and there - {node.get_name()})
        if elsewhere and f"/{TRUTH}/" not in other:
            return f"there is {other}: --ros-args -r {name}:={other}"
    domain, reach = os.environ.get("ROS_DOMAIN_ID") or "0", os.environ.get(RANGE) or "SUBNET"
    kind = msgtype.rpartition("/")[2]
    return f"no other {kind} in ROS_DOMAIN_ID {domain} ({RANGE} {reach})"


def reliability_parameter(topic: str) -> str:
    """Name of the parameter by which the user may choose the reliability of a subscription."""
    return f"qos_overrides.{topic}.subscription.reliability"


def has_chosen(node: Node, topic: str) -> bool:
    """Whether the user has chosen a reliability; ask before the first subscription, which declares.

    Args:
        node: the node.
        topic: relative name.
    """
    name = reliability_parameter(node.resolve_topic_name(topic))
    return given_parameter(node, name).type_ != Parameter.Type.NOT_SET


def publishing_nodes(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, one per publisher."""
    publishers = node.get_publishers_info_by_topic(topic)
    return sorted(f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in publishers)
