"""How the rig's parameters are declared: with a description, a range, and whole numbers allowed."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from cdrj_ros.nodes.parameters import Setting
from cdrj_ros.nodes.settings import as_double


def declare_number(
    node: Node,
    name: str,
    default: float,
    low: float,
    high: float,
    description: str,
    changeable: bool = False,
) -> float:
    """A number with its range; ``payload:=1`` means 1.0."""
    _allow_whole(node, Setting(name, default, description, "", low, high))
    descriptor = ParameterDescriptor(
        description=description,
        read_only=not changeable,
        floating_point_range=[FloatingPointRange(from_value=low, to_value=high)],
    )
    return float(node.declare_parameter(name, default, descriptor).value)


def declare_numbers(node: Node, name: str, description: str) -> list[float]:
    """Numbers that cannot change; empty where they are not set."""
    _allow_whole(node, Setting(name, None, description))
    return [float(one) for one in _array(node, name, Parameter.Type.DOUBLE_ARRAY, description)]


def declare_names(node: Node, name: str, description: str) -> list[str]:
    """Names that cannot change; empty where they are not set."""
    return [str(one) for one in _array(node, name, Parameter.Type.STRING_ARRAY, description)]


def declare_count(
    node: Node, name: str, default: int, low: int, high: int, description: str
) -> int:
    """A whole number that cannot change."""
    descriptor = ParameterDescriptor(
        description=description,
        read_only=True,
        integer_range=[IntegerRange(from_value=low, to_value=high, step=1)],
    )
    return int(node.declare_parameter(name, default, descriptor).value)


def declare_text(node: Node, name: str, default: str, description: str) -> str:
    """A text that cannot change."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return str(node.declare_parameter(name, default, descriptor).value)


def declare_flag(node: Node, name: str, default: bool, description: str) -> bool:
    """A switch that cannot change."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return bool(node.declare_parameter(name, default, descriptor).value)


def _array(node: Node, name: str, kind: Any, description: str) -> list[Any]:
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return list(node.declare_parameter(name, kind, descriptor).value or ())


def _allow_whole(node: Node, setting: Setting) -> None:
    """Take a whole number that was given for what it stands for."""
    overrides = node._parameter_overrides  # there is no public way to what was given
    given = overrides.get(setting.name)
    if given is not None:
        overrides[setting.name] = as_double(given, setting)
