"""Limits on the figures of a comparison, read from a file, for continuous integration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from typing import Final

from cdrj_ros.evaluation.channels import QUANTITIES, quantity_of
from cdrj_ros.evaluation.metrics import FIGURES, ChannelError, Errors, mean_over_channels
from cdrj_ros.foundation.errors import RobotFileError
from cdrj_ros.foundation.output import printable
from cdrj_ros.robot.document import check_document, read_text, yaml_mapping

LIMITED: Final = ("n", *FIGURES)
"""Figures that may have limits."""

JUDGED: Final = ("all", "each")
"""Values of ``judge``: "all" judges the pooled samples, "each" every recording as well."""

BOUNDS: Final = {
    "type": "object",
    "properties": {"min": {"type": "number"}, "max": {"type": "number"}},
    "additionalProperties": False,
    "minProperties": 1,
    "description": "a mapping with min, max or both.",
}
SCHEMA: Final = {
    "type": "object",
    "properties": {
        "judge": {"enum": list(JUDGED)},
        "channels": {
            "type": "object",
            "additionalProperties": {
                "type": "object",
                "properties": dict.fromkeys(LIMITED, BOUNDS),
                "additionalProperties": False,
            },
        },
    },
    "additionalProperties": False,
}
"""JSON schema of a file of limits."""


@dataclass(frozen=True)
class Limits:
    """The content of one file."""

    source: str
    """Name of the file."""
    channels: Mapping[str, Mapping[str, Mapping[str, float]]]
    """``min`` and ``max`` by figure, one of LIMITED, by a channel's name, which may contain the
    wildcards ``*``, ``?`` and ``[...]``; or by a quantity alone ("tension"), which denotes the mean
    over its channels."""
    each: bool = False
    """Whether every recording is also judged individually."""


@dataclass(frozen=True)
class Outside:
    """One figure that is not within its limit."""

    where: str
    """The recording, or "all recordings" for the pooled samples."""
    channel: str
    """The channel, or the pattern that no channel matches."""
    figure: str
    value: float | None
    """Value of the figure; None if it is unknown."""
    bound: float
    least: bool
    """Whether ``bound`` is a minimum; otherwise it is a maximum."""
    unit: str = ""
    """Unit of the channel; empty for that of its quantity."""

    @property
    def by(self) -> float | None:
        """Distance beyond the bound, at least 0, in the figure's unit; None if unknown."""
        return None if self.value is None else abs(self.value - self.bound)


@dataclass(frozen=True)
class LimitCheck:
    """Result of comparing figures with limits."""

    source: str
    checked: int
    """Number of comparisons of a figure with a bound."""
    outside: tuple[Outside, ...]


def load_limits(path: str | Path) -> Limits:
    """Read a file of limits, ``channels: {PATTERN: {FIGURE: {min: X, max: X}}}``.

    Raises:
        RobotFileError: with one line that names the key, what was given and what is allowed.
    """
    return parse_limits(read_text(path, "file of limits"), str(path))


def parse_limits(text: str, source: str) -> Limits:
    """The limits of a YAML text.

    Raises:
        RobotFileError: as ``load_limits``.
    """
    document = yaml_mapping(text, source, "channels and judge")
    check_document(document, SCHEMA, source)
    channels = document.get("channels", {})
    for pattern, figures in channels.items():
        prefix = str(pattern).partition("/")[0]
        if prefix not in QUANTITIES and not any(character in prefix for character in "*?["):
            known = ", ".join(f"{key}, {key}/…" for key in QUANTITIES)
            raise RobotFileError(
                f"channels.{printable(pattern)} names no channel; names are {known} ({source})"
            )
        for figure, bounds in figures.items():
            if len(bounds) == 2 and bounds["min"] > bounds["max"]:
                raise RobotFileError(
                    f"channels.{pattern}.{figure}.min must be at most max = {bounds['max']:g}, "
                    f"got {bounds['min']:g} ({source})"
                )
    if not any(channels.values()):
        raise RobotFileError(f"channels names no limit ({source})")
    return Limits(source, channels, document.get("judge") == "each")


def check_limits(limits: Limits, errors: Errors) -> LimitCheck:
    """Compare the figures with their limits.

    An unknown figure counts as outside, and so does a pattern without a match.
    """
    judged = [("all recordings", errors.pooled)]
    if len(errors.bags) == 1:
        judged = [(errors.bags[0].path, errors.pooled)]
    elif limits.each:
        judged += [(bag.path, own) for bag, own in zip(errors.bags, errors.of_bags, strict=True)]
    checked = 0
    outside: list[Outside] = []
    for (where, errors_by_name), (pattern, figures) in product(judged, limits.channels.items()):
        matching = _matching(pattern, errors_by_name)
        for figure, bounds in figures.items():
            for key, bound in bounds.items():
                checked += max(len(matching), 1)
                least = key == "min"
                if not matching:
                    outside.append(Outside(where, pattern, figure, None, bound, least))
                for name, error in matching.items():
                    value = getattr(error, figure)
                    if value is None or (value < bound if least else value > bound):
                        outside.append(
                            Outside(where, name, figure, value, bound, least, error.unit)
                        )
    return LimitCheck(limits.source, checked, tuple(outside))


def _matching(pattern: str, errors: Mapping[str, ChannelError]) -> dict[str, ChannelError]:
    if pattern in QUANTITIES:
        members = [error for name, error in errors.items() if quantity_of(name) == pattern]
        return {pattern: mean_over_channels(members)} if members else {}
    return {name: error for name, error in errors.items() if fnmatchcase(name, pattern)}
