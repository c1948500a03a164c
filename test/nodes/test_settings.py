"""From a node's table follow its declaration, its parameter file and the values that it reads."""

import pytest
import yaml

pytest.importorskip("rclpy")
pytest.importorskip("viser", reason="viser, which the node view needs, is not installed")

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.nodes import markers, parameters, rig_settings, view
from cdrj_ros.nodes.settings import (
    Setting,
    declare,
    parameter_file,
    refuse_unknown_parameters,
    values_of,
)

TABLES = {
    "estimator": parameters.settings(),
    "rig": rig_settings.SETTINGS,
    "markers": markers.SETTINGS,
    "view": view.SETTINGS,
    "made_up": (
        Setting("count", 3, "How many", "", 0, 5),
        Setting("share", 0.5, "How much", "-", 0.0, 1.0, changeable=True),
        Setting("names", ("a", "b"), "Which"),
        Setting("mode", "on", "How", choices=("on", "off")),
        Setting("numbers", Parameter.Type.DOUBLE_ARRAY, "More numbers"),
    ),
}


@pytest.fixture
def context():
    made = rclpy.Context()
    rclpy.init(context=made)
    yield made
    rclpy.shutdown(context=made)


def declared(context, name, *words, **given):
    """The values that a node with this table reads, with ROS arguments or overrides."""
    table = TABLES[name]
    overrides = [Parameter(key, value=value) for key, value in given.items()]
    node = Node(name, context=context, cli_args=[*words], parameter_overrides=overrides)
    try:
        declare(node, table)
        for one in table:
            told = node.describe_parameter(one.name)
            assert told.description == one.text
            assert told.read_only is not one.changeable
            limits = [*told.floating_point_range, *told.integer_range]
            assert [(each.from_value, each.to_value) for each in limits] == (
                [(one.low, one.high)] if one.bounded else []
            )
        return values_of(node, table)
    finally:
        node.destroy_node()


@pytest.mark.parametrize("name", TABLES)
def test_the_parameter_file_declares_the_table_at_its_defaults(name, context, tmp_path):
    text = parameter_file(name, TABLES[name])
    (tmp_path / "given.yaml").write_text(text)
    values = declared(context, name, "--ros-args", "--params-file", str(tmp_path / "given.yaml"))
    expected = {
        one.name: list(one.default) if isinstance(one.default, tuple) else one.default
        for one in TABLES[name]
        if not isinstance(one.default, Parameter.Type)
    }
    assert {key: value for key, value in values.items() if key in expected} == expected
    assert all(value is None for key, value in values.items() if key not in expected)
    (node,) = yaml.safe_load(text).values()
    there = node["ros__parameters"]
    flat = {key: one for key, one in there.items() if not isinstance(one, dict)}
    flat |= {f"{k}.{key}": v for k, one in there.items() if isinstance(one, dict)
             for key, v in one.items()}  # fmt: skip
    assert flat == expected


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"count": 6}, ParameterException),
        ({"count": "6"}, ParameterException),
        ({"share": 1.5}, ParameterException),
        ({"names": [1, 2]}, ParameterException),
        ({"mode": "maybe"}, UsageError),
    ],
)
def test_values_outside_the_table_are_refused(given, error, context):
    with pytest.raises(error):
        declared(context, "made_up", **given)


def test_integers_are_taken_for_doubles(context):
    values = declared(context, "made_up", share=1, numbers=[1, 2], names=["c"], count=0)
    assert values == {
        "count": 0, "share": 1.0, "names": ["c"], "mode": "on", "numbers": [1.0, 2.0],
    }  # fmt: skip


def test_unknown_names_on_the_command_line_are_refused():
    def check(*rules):
        flags = [word for rule in rules for word in ("-p", rule)]
        refuse_unknown_parameters(["rig", "--ros-args", *flags], TABLES["rig"])

    check("robot:=a", "use_sim_time:=true", "other:name:=1", "qos_overrides./a.publisher.depth:=1")
    with pytest.raises(UsageError, match=r"there is no parameter robto; did you mean robot\?"):
        check("rate:=500.0", "robto:=a")
    with pytest.raises(UsageError, match="there is no parameter stiffness; there are robot, "):
        check("stiffness:=1")
