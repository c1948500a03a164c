"""Quality of service from a file, and the one that a recording says was offered."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rclpy.duration import Duration
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSProfile,
    ReliabilityPolicy,
)
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.nodes.qos import default_profile

_POLICIES: Final[Mapping[str, Any]] = {
    "history": HistoryPolicy,
    "reliability": ReliabilityPolicy,
    "durability": DurabilityPolicy,
    "liveliness": LivelinessPolicy,
}
_DURATIONS: Final = ("deadline", "lifespan", "liveliness_lease_duration")


def read_overrides(path: str) -> dict[str, QoSProfile]:
    """Profiles by topic, from a file in the format of `ros2 bag play --qos-profile-overrides-path`.

    Raises:
        UsageError: the file is invalid; the message names the topic and the key.
        OSError: the file cannot be read.
    """
    try:
        content: Any = YAML(typ="safe").load(Path(path).read_text(encoding="utf-8"))
    except (YAMLError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(content, Mapping):
        raise UsageError(f"{path} must map topics to policies, for instance /tf: {{depth: 10}}")
    return {str(topic): profile(values, f"{path}: {topic}") for topic, values in content.items()}


def profile(values: Any, where: str) -> QoSProfile:
    """A profile from policies by name; all others are those of ``default_profile``.

    Raises:
        UsageError: an unknown policy or value.
    """
    if not isinstance(values, Mapping):
        raise UsageError(f"{where} must map policies to values, got {values!r}")
    made = default_profile()
    for key, value in values.items():
        if key in _POLICIES:
            setattr(made, key, _policy(key, value, where))
        elif key in _DURATIONS:
            setattr(made, key, _duration(value, f"{where}.{key}"))
        elif key == "depth":
            if not isinstance(value, int) or isinstance(value, bool) or not 0 < value < 2**31:
                raise UsageError(f"{where}.depth must be a positive whole number, got {value!r}")
            made.depth = value
        elif key == "avoid_ros_namespace_conventions":
            made.avoid_ros_namespace_conventions = bool(value)
        else:
            known = ", ".join((*_POLICIES, "depth", *_DURATIONS))
            raise UsageError(f"{where}: there is no policy {key!r}, only {known}")
    return made


def _policy(key: str, value: Any, where: str) -> Any:
    names = {policy.name.lower(): policy for policy in _POLICIES[key] if policy.name != "UNKNOWN"}
    if isinstance(value, int):
        names = {int(policy): policy for policy in names.values()}
    if value not in names:
        allowed = ", ".join(str(name) for name in names)
        raise UsageError(f"{where}.{key} must be one of {allowed}, got {value!r}")
    return names[value]


def _duration(value: Any, where: str) -> Duration:
    try:
        return Duration(seconds=int(value["sec"]), nanoseconds=int(value["nsec"]))
    except (TypeError, KeyError, ValueError):
        raise UsageError(f"{where} must be {{sec: S, nsec: N}}, got {value!r}") from None


def was_latched(offered: str) -> bool:
    """Whether a recording's `offered_qos_profiles` include transient-local durability."""
    try:
        profiles: Any = YAML(typ="safe").load(offered) if offered else None
    except YAMLError:
        return False
    if not isinstance(profiles, list):
        return False
    latched = (int(DurabilityPolicy.TRANSIENT_LOCAL), "transient_local")
    return any(isinstance(p, Mapping) and p.get("durability") in latched for p in profiles)
