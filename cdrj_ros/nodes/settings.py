"""The estimator's parameters: declared with words, ranges and units; what may change, and how."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from cdrj_ros.conditioning.time_line import MODES
from cdrj_ros.estimation.session import LiveEstimator, Options
from cdrj_ros.foundation.errors import CdrjError, UsageError
from cdrj_ros.robot.document import LARGEST, schema
from cdrj_ros.robot.parameters import number_at

FRICTION: Final = (
    "mu_c",
    "mu_s",
    "rho",
    "bearing_friction",
    "bristle_stiffness",
    "viscous",
)
"""Keys of the robot file's common friction that may change while running."""

UNSET: Final = -1.0
"""Value of a parameter that leaves the robot file's."""

TRACKING: Final = "tracking_bandwidth"
SLOWEST_HZ, FASTEST_HZ = 0.1, 1000.0


def declare_text(node: Node, name: str, default: str, description: str) -> str:
    """A text that cannot change."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return str(node.declare_parameter(name, default, descriptor).value)


def declare_flag(node: Node, name: str, default: bool, description: str) -> bool:
    """A switch that cannot change."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return bool(node.declare_parameter(name, default, descriptor).value)


def declare_number(
    node: Node,
    name: str,
    default: float,
    low: float,
    high: float,
    description: str,
    read_only: bool = False,
) -> float:
    """A number with its range."""
    descriptor = ParameterDescriptor(
        description=description,
        read_only=read_only,
        floating_point_range=[FloatingPointRange(from_value=low, to_value=high)],
    )
    return float(node.declare_parameter(name, default, descriptor).value)


def declare_options(node: Node) -> Options:
    """How to run.

    Raises:
        UsageError: a mode that does not exist.
    """
    mode = declare_text(
        node, "conditioning", "wait", "wait for the slower topic, or predict it with its velocity"
    )
    if mode not in MODES:
        raise UsageError(f"conditioning must be one of {', '.join(MODES)}, got {mode!r}")
    return Options(
        conditioning=mode,
        uncertainty=declare_flag(
            node, "uncertainty", True, "Whether to estimate standard deviations"
        ),
        unsure_share=declare_number(
            node, "unsure_share", 0.1, 0.001, 10.0,
            "An element is UNSURE whose standard deviation exceeds this share of its tension or "
            "preload [-]",
        ),
        tension_sensors=declare_flag(
            node, "tension_sensors", False, "Whether to use load cells on ~tension_sensors"
        ),
        track_preload=declare_flag(
            node, "track_preload", False,
            "Whether to correct preloads by the efforts in motor_states",
        ),
        effort_noise=declare_number(
            node, "effort_noise", 0.01, 1e-6, 1e6,
            "Standard deviation of the efforts in motor_states [N m]", read_only=True,
        ),
        tracking=_bandwidth(
            declare_number(
                node, TRACKING, UNSET, UNSET, FASTEST_HZ,
                "Bandwidth of the filters that find an angle between the counts of its sensor, of "
                f"all sensors whose resolution or noise is given [Hz]; 0: no filter; {UNSET:g}: "
                "the robot file's",
            )
        ),
    )  # fmt: skip


def _bandwidth(value: float) -> float | None:
    """What the parameter means: see ``Options.tracking``."""
    if value == UNSET:
        return None
    if value == 0.0 or SLOWEST_HZ <= value <= FASTEST_HZ:
        return value
    raise UsageError(
        f"{TRACKING} must be in [{SLOWEST_HZ:g}, {FASTEST_HZ:g}] Hz, 0 for no filter, or "
        f"{UNSET:g} for the robot file's; got {value:g}"
    )


def declare_preload(node: Node) -> Sequence[float] | None:
    """Preloads of all cables [N], or None for the robot file's."""
    value: Any = node.declare_parameter(
        "preload",
        Parameter.Type.DOUBLE_ARRAY,
        ParameterDescriptor(
            description="Preload of every cable in the reference pose [N]; unset: the robot "
            "file's. Setting it starts the estimate anew"
        ),
    ).value
    return value or None


def declare_friction(node: Node) -> dict[str, float]:
    """Common friction that is given as parameters instead of in the robot file, by path."""
    rules = schema()["$defs"]["friction"]["properties"]
    given = {}
    for key in FRICTION:
        rule = rules[key]
        value = declare_number(
            node, f"friction.{key}", UNSET, UNSET, float(rule.get("maximum", 1e12)),
            f"{rule['description']} Instead of the robot file's common value; {UNSET:g}: that one",
        )  # fmt: skip
        if value != UNSET:
            if not 0.0 <= value <= LARGEST:
                raise UsageError(f"friction.{key} must be at least 0, or {UNSET:g}; got {value:g}")
            given[f"friction.{key}"] = value
    return given


def _friction_value(live: LiveEstimator, name: str, value: float) -> float:
    """What a friction parameter means."""
    if value == UNSET:
        return number_at(dict(live.started.robot.document), name)
    if not 0.0 <= value <= LARGEST:
        raise UsageError(f"{name} must be in [0, {LARGEST:g}], or {UNSET:g}; got {value:g}")
    return value


def _checked(
    live: LiveEstimator, changes: Sequence[Parameter]
) -> tuple[dict[str, float], Sequence[float] | None]:
    """Friction by path and preloads that are asked for.

    Raises:
        UsageError: a value that cannot be, of any parameter.
    """
    values: dict[str, float] = {}
    preload: Sequence[float] | None = None
    for change in changes:
        if change.name.startswith("friction."):
            values[change.name] = _friction_value(live, change.name, float(change.value))
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
    """Apply changes of parameters to a running estimator, all or none.

    Returns:
        What was done, in words; empty where nothing concerns the estimator.

    Raises:
        CdrjError: what is wrong; nothing has changed then.
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
