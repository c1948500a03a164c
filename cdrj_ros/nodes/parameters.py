"""The estimator's parameters: the table, and what their values at the start mean."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, Final

from rclpy.parameter import Parameter

from cdrj_ros.estimation.conditioner import MODES
from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.estimation.session import Options
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.nodes.robot_description import ROBOT_SETTINGS
from cdrj_ros.nodes.settings import Setting, parameter_file
from cdrj_ros.nodes.silence import SAME_CLOCK_S
from cdrj_ros.robot.document import schema

UNSET: Final = -1.0
"""Value of a number for which the robot file's value is used."""

FRICTION: Final = ("mu_c", "mu_s", "rho", "bearing_friction")
"""Keys of the robot file's common friction that may change while the node runs."""

SLOWEST_HZ: Final = 0.1
FASTEST_HZ: Final = 1000.0
"""Range of the bandwidth of the filters that interpolate between encoder counts [Hz]."""

TRACKING: Final = "tracking_bandwidth"


@cache
def settings() -> tuple[Setting, ...]:
    """Every parameter of the estimator, in the order of the parameter file."""
    rules = schema()["$defs"]["friction"]["properties"]
    friction = tuple(
        Setting(
            f"friction.{key}", UNSET,
            f"{rules[key]['description']} Common value; shows the one in force. Setting "
            f"{UNSET:g} returns to the robot file's",
            low=UNSET, high=float(rules[key].get("maximum", 1e12)), changeable=True,
        )
        for key in FRICTION
    )  # fmt: skip
    return (*ROBOT_SETTINGS, *_SETTINGS, *friction)


_SETTINGS: Final = (
    Setting("timeout", 0.5, "Silence after which outputs are marked STALE", "s", 0.001, 3600.0),
    Setting(
        "same_clock_within", SAME_CLOCK_S,
        "Estimates that lag the clock of this node by more than the timeout are STALE. If the "
        "first readings lag it by more than this value, their stamps are taken to be those of a "
        "recording or of another clock; then only the lag beyond the smallest one so far counts. "
        "0: never compare with this clock, for a recording that is paused or played slowly",
        "s", 0.0, 1e10,
    ),
    Setting(
        "frame_id", "",
        "frame_id of the outgoing headers, the robot's base frame; empty: base_link of the robot "
        "file, the root link of its URDF, or base",
    ),
    Setting(
        "preload", Parameter.Type.DOUBLE_ARRAY,
        "Preload of every cable in the reference pose; not set: the robot file's. Shows the "
        "values in force. Setting it restarts the estimate",
        "N", changeable=True,
    ),
    Setting(
        "conditioning", MODES[0],
        "What to do while a topic lags: wait for it, or predict it with its velocity",
        choices=tuple(MODES),
    ),
    Setting(
        "max_rate", 0.0,
        "Estimates published per second of the stamps at most; 0: no limit. Every sample is "
        "computed in any case",
        "Hz", 0.0, 1e5,
    ),
    Setting(
        "unsure_share", UNSURE_SHARE,
        "An element is UNSURE if its standard deviation exceeds this share of its tension or "
        "preload",
        "-", 0.001, 10.0, changeable=True,
    ),
    Setting(
        "ignored_sensors", "",
        "Sensors that do not correct the estimate, separated by commas: load cells by element, and "
        "motors and joints whose efforts are published; *: all. The others are used as soon as "
        "they are heard",
    ),
    Setting(
        TRACKING, UNSET,
        "Bandwidth of the filters that estimate angles between the counts of a sensor, for all "
        f"sensors whose resolution or noise is given; 0: no filter; {UNSET:g}: the robot "
        "file's",
        "Hz", UNSET, FASTEST_HZ, changeable=True,
    ),
)  # fmt: skip


def estimator_file() -> str:
    """Every parameter at its default, with its description, unit and range as comments (YAML)."""
    return parameter_file(
        "estimator",
        settings(),
        usage="#   ros2 launch cdrj_ros estimator.launch.py robot:=my_robot.yaml "
        "params_file:=my.params.yaml\n",
        remarks=""" The quality of service of every topic
# can be overridden too, for example of an output:
#
#   qos_overrides: {/cdrj/tensions: {publisher: {reliability: best_effort, depth: 10}}}""",
    )


def options_of(values: Mapping[str, Any]) -> Options:
    """The estimator's options, by the values of the parameters.

    Raises:
        UsageError: a value is not allowed; ROS itself checks types and ranges.
    """
    return Options(
        conditioning=values["conditioning"],
        unsure_share=values["unsure_share"],
        ignored_sensors=tuple(filter(None, map(str.strip, values["ignored_sensors"].split(",")))),
        tracking=bandwidth(values[TRACKING]),
    )


def friction_of(values: Mapping[str, Any]) -> dict[str, float]:
    """Common friction values that replace those of the robot file, by path."""
    given = {name: float(values[name]) for name in (f"friction.{key}" for key in FRICTION)}
    return {name: value for name, value in given.items() if value != UNSET}


def bandwidth(value: float) -> float | None:
    """The value of ``Options.tracking`` for a value of the parameter."""
    if value == UNSET:
        return None
    if value == 0.0 or SLOWEST_HZ <= value <= FASTEST_HZ:
        return value
    raise UsageError(
        f"{TRACKING} must be in [{SLOWEST_HZ:g}, {FASTEST_HZ:g}] Hz, 0 for no filter, or "
        f"{UNSET:g} for the robot file's; got {value:g}"
    )
