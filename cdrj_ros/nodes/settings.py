"""Declare, read and change the estimator's ROS parameters, which ``parameters`` lists."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter

from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.nodes.parameters import (
    FASTEST_HZ,
    FRICTION,
    SLOWEST_HZ,
    UNSET,
    OutputMode,
    Setting,
    settings,
)
from cdrj_ros.robot.document import schema
from cdrj_ros.robot.parameters import allowed_range, number_at

TRACKING: Final = "tracking_bandwidth"
SIMULATED: Final = "use_sim_time"

_DOUBLES: Final = (Parameter.Type.DOUBLE, Parameter.Type.DOUBLE_ARRAY)


class Started(NamedTuple):
    """The parameters that the node reads once, at its start."""

    robot: str
    timeout_s: float
    same_clock_s: float
    frame_id: str
    preload: list[float] | None
    """Preload of every cable [N]; None for the robot file's."""
    output: OutputMode
    max_rate_hz: float
    """Maximum rate of published estimates [Hz]; 0: no limit."""
    tension_states: bool
    wrenches: bool
    """Whether to publish these outputs too."""
    options: Options
    health: bool
    """Whether to run the health monitor."""
    health_marks: bool
    """Whether its verdict marks elements ``UNSURE``."""
    friction: dict[str, float]
    """Common friction values that replace those of the robot file, by path."""


def declare(node: Node, *, fixed: bool = True) -> None:
    """Declare every parameter.

    Args:
        node: the node.
        fixed: whether those that cannot change while the estimator runs are read-only for ROS.
    """
    for setting in settings():
        declare_with_integers(node, setting.name, _kind(setting), _descriptor(setting, fixed=fixed))


def read(node: Node) -> Started:
    """Read every parameter.

    Raises:
        UsageError: a value is not allowed; ROS itself checks types and ranges.
    """
    values: dict[str, Any] = {}
    for setting in settings():
        value = node.get_parameter_or(setting.name).value
        if setting.choices and value not in setting.choices:
            raise UsageError(
                f"{setting.name} must be one of {', '.join(setting.choices)}, got {value!r}"
            )
        values[setting.name] = value
    options = Options(
        conditioning=values["conditioning"],
        uncertainty=values["uncertainty"],
        unsure_share=values["unsure_share"],
        tension_sensors=values["tension_sensors"],
        track_preload=values["track_preload"],
        effort_noise=values["effort_noise"],
        tracking=_bandwidth(values[TRACKING]),
    )
    return Started(
        values["robot"],
        values["timeout"],
        values["same_clock_within"],
        values["frame_id"],
        list(values["preload"] or ()) or None,
        values["output"],
        values["max_rate"],
        values["tension_states"],
        values["wrenches"],
        options,
        values["health"],
        values["health_marks_unsure"],
        _given_friction(values),
    )


def _kind(setting: Setting) -> Any:
    """The default, or the type of a setting without one."""
    return Parameter.Type.DOUBLE_ARRAY if setting.default is None else setting.default


def _descriptor(setting: Setting, *, fixed: bool) -> ParameterDescriptor:
    limits = [FloatingPointRange(from_value=setting.low, to_value=setting.high)]
    return ParameterDescriptor(
        description=setting.words,
        read_only=fixed and not setting.changeable,
        floating_point_range=limits if setting.bounded else [],
    )


def declare_with_integers(
    node: Node, name: str, kind: Any, descriptor: ParameterDescriptor
) -> Parameter:
    """Declare a parameter; integers are given for doubles, too: ``timeout:=1`` means 1.0.

    Args:
        node: the node.
        name: of the parameter.
        kind: its default, or its type if it has none.
        descriptor: its description and range.

    Raises:
        ParameterException: the given value has another type, or is out of range.
    """
    try:
        return node.declare_parameter(name, kind, descriptor)
    except InvalidParameterTypeException:
        given = given_parameter(node, name)
        double = as_double(given, kind)
        if double is given:
            raise
        return node.declare_parameter(name, double.value, descriptor, ignore_override=True)


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


def _bandwidth(value: float) -> float | None:
    """The value of ``Options.tracking`` for a value of the parameter."""
    if value == UNSET:
        return None
    if value == 0.0 or SLOWEST_HZ <= value <= FASTEST_HZ:
        return value
    raise UsageError(
        f"{TRACKING} must be in [{SLOWEST_HZ:g}, {FASTEST_HZ:g}] Hz, 0 for no filter, or "
        f"{UNSET:g} for the robot file's; got {value:g}"
    )


def _given_friction(values: dict[str, Any]) -> dict[str, float]:
    given = {}
    for name in (f"friction.{key}" for key in FRICTION):
        value = float(values[name])
        if value != UNSET:
            given[name] = _checked_friction(name, value)
    return given


def _checked_friction(name: str, value: float) -> float:
    key = name.removeprefix("friction.")
    allowed = allowed_range(schema()["$defs"]["friction"]["properties"][key])
    if value not in allowed:
        raise UsageError(f"{name} must be in {allowed}, or {UNSET:g}; got {value:g}")
    return value


def in_force(live: LiveEstimator) -> list[Parameter]:
    """Current values of the parameters that services and the state file can change."""
    robot = live.model.robot
    document = dict(robot.document)
    return [
        Parameter("preload", value=[float(cable.preload) for cable in robot.cables]),
        *(
            Parameter(name, value=float(number_at(document, name)))
            for name in (f"friction.{key}" for key in FRICTION)
        ),
    ]


def meant(live: LiveEstimator | None, changes: Sequence[Parameter]) -> list[Parameter]:
    """The changes with the values that they stand for.

    Integers become doubles. ``UNSET`` of ``friction.*`` becomes the robot file's value, so that the
    parameter shows the value in use; not without an estimator.
    """
    by_name = {setting.name: setting for setting in settings()}
    found = []
    for change in changes:
        setting = by_name.get(change.name)
        one = change if setting is None else as_double(change, _kind(setting))
        unset = one.name.startswith("friction.") and one.value == UNSET
        if live is not None and unset and setting is not None:
            one = Parameter(
                one.name, value=float(number_at(dict(live.started.robot.document), one.name))
            )
        found.append(one)
    return found


def _checked(
    live: LiveEstimator, changes: Sequence[Parameter]
) -> tuple[dict[str, float], Sequence[float] | None]:
    """The requested friction values by path and the requested preloads.

    Raises:
        UsageError: a value of any parameter is invalid.
    """
    values: dict[str, float] = {}
    preload: Sequence[float] | None = None
    for change in changes:
        if change.name.startswith("friction."):
            values[change.name] = _checked_friction(change.name, float(change.value))
        elif change.name == "preload":
            if change.value is None:
                raise UsageError("preload cannot be unset while running")
            preload = list(change.value)
        elif change.name == "unsure_share" and not change.value > 0.0:
            raise UsageError(f"unsure_share must be greater than 0, got {change.value:g}")
        elif change.name == TRACKING:
            _bandwidth(float(change.value))
    cables = [cable.name for cable in live.model.robot.cables]
    if preload is not None and len(preload) != len(cables):
        raise UsageError(
            f"preload needs {len(cables)} tensions, of {', '.join(cables)}; got {len(preload)}"
        )
    if preload is not None and not all(0.0 <= value < 1e6 for value in preload):
        raise UsageError(f"preload must be in [0, 1e6) N, got {preload}")
    return values, preload


def changed_options(live: LiveEstimator, changes: Sequence[Parameter]) -> str:
    """Apply all changes of parameters to a running estimator, or none of them.

    Returns:
        A description of the changes; empty if none concerns the estimator.

    Raises:
        CdrjError: a change is invalid; no change has been applied then.
    """
    values, preload = _checked(live, changes)
    words = []
    cables = [cable.name for cable in live.model.robot.cables]
    before = live.model
    if values:
        words.append(live.set_numbers(values))
    if preload is not None:
        try:
            words.append(live.set_preload(dict(zip(cables, preload, strict=True))))
        except CdrjError:
            if values:
                live.use(before)
            raise
    for change in changes:
        if change.name == "unsure_share":
            live.set_unsure_share(float(change.value))
            words.append(f"unsure_share = {change.value:g}")
        elif change.name == TRACKING:
            live.set_tracking(_bandwidth(float(change.value)))
            words.append(f"{TRACKING} = {change.value:g}")
    return "; ".join(words)
