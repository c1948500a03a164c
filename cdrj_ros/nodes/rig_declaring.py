"""Declare the rig's parameters with description and range; integers are accepted as doubles."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from cdrj_ros.nodes.settings import declare_with_integers


def declare_number(
    node: Node,
    name: str,
    default: float,
    low: float,
    high: float,
    description: str,
    changeable: bool = False,
) -> float:
    """Declare a number with its range; ``payload:=1`` means 1.0."""
    descriptor = ParameterDescriptor(
        description=description,
        read_only=not changeable,
        floating_point_range=[FloatingPointRange(from_value=low, to_value=high)],
    )
    return float(declare_with_integers(node, name, default, descriptor).value)


def declare_numbers(node: Node, name: str, description: str) -> list[float]:
    """Declare a read-only array of numbers; empty if it is not set."""
    return [float(one) for one in _array(node, name, Parameter.Type.DOUBLE_ARRAY, description)]


def declare_names(node: Node, name: str, description: str) -> list[str]:
    """Declare a read-only array of names; empty if it is not set."""
    return [str(one) for one in _array(node, name, Parameter.Type.STRING_ARRAY, description)]


def declare_count(
    node: Node, name: str, default: int, low: int, high: int, description: str
) -> int:
    """Declare a read-only integer."""
    descriptor = ParameterDescriptor(
        description=description,
        read_only=True,
        integer_range=[IntegerRange(from_value=low, to_value=high, step=1)],
    )
    return int(node.declare_parameter(name, default, descriptor).value)


def declare_text(node: Node, name: str, default: str, description: str) -> str:
    """Declare a read-only string."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return str(node.declare_parameter(name, default, descriptor).value)


def declare_flag(node: Node, name: str, default: bool, description: str) -> bool:
    """Declare a read-only boolean."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return bool(node.declare_parameter(name, default, descriptor).value)


def _array(node: Node, name: str, kind: Any, description: str) -> list[Any]:
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return list(declare_with_integers(node, name, kind, descriptor).value or ())
