"""The estimator's parameters as data: names, defaults, units, ranges.  Does not depend on ROS.

The node declares exactly these, and ``config/estimator.params.yaml`` is ``parameter_file()``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from textwrap import wrap
from typing import Final, Literal, get_args

from cdrj_ros.conditioning.conditioner import MODES
from cdrj_ros.estimation.ensemble import UNSURE_SHARE
from cdrj_ros.nodes.silence import SAME_CLOCK_S
from cdrj_ros.robot.document import schema

UNSET: Final = -1.0
"""Value of a number for which the robot file's value is used."""

OutputMode = Literal["every_sample", "motor_stamps"]
OUTPUT_MODES: Final[tuple[OutputMode, ...]] = get_args(OutputMode)

FRICTION: Final = (
    "mu_c",
    "mu_s",
    "rho",
    "bearing_friction",
    "bristle_stiffness",
    "viscous",
)
"""Keys of the robot file's common friction that may change while the node runs."""

SLOWEST_HZ: Final = 0.1
FASTEST_HZ: Final = 1000.0
"""Range of the bandwidth of the filters that interpolate between encoder counts [Hz]."""

WIDTH: Final = 96
"""Maximum line length of comments in the parameter file [columns]."""


@dataclass(frozen=True)
class Setting:
    """One parameter."""

    name: str
    default: bool | float | str | None
    """None for an array of numbers that is not set."""
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
        return isinstance(self.default, float)

    @property
    def words(self) -> str:
        """The description with the choices and the unit."""
        choices = f" ({' or '.join(self.choices)})" if self.choices else ""
        unit = f" [{self.unit}]" if self.unit else ""
        return f"{self.description}{choices}{unit}"


DESCRIPTION_WORDS: Final = (
    "URDF for a robot file whose frames name robot_description; empty: from the topic "
    "/robot_description"
)


@cache
def settings() -> tuple[Setting, ...]:
    """Every parameter of the estimator, in the order of the parameter file."""
    return (
        Setting("robot", "", "Robot file (YAML), or the name of an installed one; required"),
        Setting(
            "robot_description", "", DESCRIPTION_WORDS,
        ),
        Setting("timeout", 0.5, "Silence after which outputs are marked STALE", "s", 0.001, 3600.0),
        Setting(
            "same_clock_within", SAME_CLOCK_S,
            "Estimates that lag the clock of this node by more than the timeout are STALE. Where "
            "the first readings lag it by more than this, their stamps are those of a recording or "
            "of another clock, and only what estimates lag beyond the smallest lag so far counts. "
            "0: never compare with this clock, for a recording that is paused or played slowly",
            "s", 0.0, 1e10,
        ),
        Setting("frame_id", "", "frame_id of the outgoing headers"),
        Setting(
            "preload", None,
            "Preload of every cable in the reference pose; not set: the robot file's. Shows the "
            "values in force. Setting it restarts the estimate",
            "N", changeable=True,
        ),
        Setting(
            "conditioning", MODES[0],
            "What to do while a topic lags: wait for it, or predict it with its velocity",
            choices=tuple(MODES),
        ),
        *_output_settings(),
        Setting("uncertainty", True, "Whether to estimate standard deviations"),
        Setting(
            "unsure_share", UNSURE_SHARE,
            "An element is UNSURE if its standard deviation exceeds this share of its tension or "
            "preload",
            "-", 0.001, 10.0, changeable=True,
        ),
        *_sensor_settings(),
        Setting(
            "tracking_bandwidth", UNSET,
            "Bandwidth of the filters that estimate angles between the counts of a sensor, for all "
            f"sensors whose resolution or noise is given; 0: no filter; {UNSET:g}: the robot "
            "file's",
            "Hz", UNSET, FASTEST_HZ, changeable=True,
        ),
        *_friction_settings(),
    )  # fmt: skip


def _output_settings() -> tuple[Setting, ...]:
    return (
        Setting(
            "output", OUTPUT_MODES[0],
            "Samples of which the estimate is published: all, or those at the stamps of motors. "
            "Every sample is computed in any case",
            choices=OUTPUT_MODES,
        ),
        Setting(
            "max_rate", 0.0,
            "Estimates published per second of the stamps at most; 0: no limit. Every sample is "
            "computed in any case",
            "Hz", 0.0, 1e5,
        ),
        Setting(
            "tension_states", False,
            "Whether to publish the tensions on the topic tension_states too, as efforts of a "
            "JointState, which PlotJuggler and rqt show by name",
        ),
        Setting(
            "wrenches", False,
            "Whether to publish the force on every pulley as geometry_msgs/WrenchStamped on "
            "wrenches/<cable>_<node>",
        ),
    )  # fmt: skip


def _sensor_settings() -> tuple[Setting, ...]:
    return (
        Setting("tension_sensors", False, "Whether to use load cells on the topic tension_sensors"),
        Setting(
            "track_preload", False, "Whether to correct preloads by the efforts in motor_states"
        ),
        Setting(
            "effort_noise", 0.01, "Standard deviation of the efforts in motor_states", "N m",
            1e-6, 1e6,
        ),
        Setting(
            "health", True,
            "Whether to compare the efforts in motor_states and the load cells with the estimate, "
            "and to report on /diagnostics what has changed on the robot",
        ),
        Setting(
            "health_marks_unsure", True,
            "Whether the elements that such a change concerns are UNSURE while it lasts",
        ),
    )  # fmt: skip


def _friction_settings() -> tuple[Setting, ...]:
    rules = schema()["$defs"]["friction"]["properties"]
    return tuple(
        Setting(
            f"friction.{key}", UNSET,
            f"{rules[key]['description']} Common value; shows the one in force. Setting "
            f"{UNSET:g} returns to the robot file's",
            low=UNSET, high=float(rules[key].get("maximum", 1e12)), changeable=True,
        )
        for key in FRICTION
    )  # fmt: skip


_HEADER: Final = """\
# Parameters of the estimator at their defaults. Copy this file, edit the copy and start with
#
#   ros2 run cdrj_ros estimator --ros-args --params-file my.params.yaml
#   ros2 launch cdrj_ros estimator.launch.py robot:=my_robot.yaml params_file:=my.params.yaml
#
# Written by `ros2 run cdrj_ros estimator --print-parameters`. The quality of service of every topic
# can be overridden too, for example of an output:
#
#   qos_overrides: {/cdrj/tensions: {publisher: {reliability: best_effort, depth: 10}}}
/**/estimator:
  ros__parameters:
"""


def parameter_file() -> str:
    """Every parameter at its default, with its description, unit and range as comments (YAML)."""
    lines = []
    inside = ""
    for setting in settings():
        group, _, key = setting.name.rpartition(".")
        if group != inside:
            lines.append(f"    {group}:")
            inside = group
        indent = "      " if group else "    "
        limits = f" Range {setting.low:g} to {setting.high:g}." if setting.bounded else ""
        when = "May change while running." if setting.changeable else "Read-only."
        comment = f"{setting.words.rstrip('.')}.{limits} {when}"
        lines += [f"{indent}# {line}" for line in wrap(comment, WIDTH - len(indent))]
        if setting.default is None:
            lines.append(f"{indent}# {key}: []")
        else:
            lines.append(f"{indent}{key}: {_yaml(setting.default)}")
    return _HEADER + "\n".join(lines) + "\n"


def _yaml(value: bool | float | str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else f'"{value}"'
