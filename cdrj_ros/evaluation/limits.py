"""Limits on the figures of a comparison, read from a file, for continuous integration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase
from math import isfinite
from pathlib import Path
from typing import Any, Final

from cdrj_ros.evaluation.channels import QUANTITIES, quantity_of
from cdrj_ros.evaluation.metrics import FIGURES, ChannelError, Errors, mean_over_channels
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.yaml import YamlError, load_yaml

LIMITED: Final = ("n", *FIGURES)
"""Figures that may have limits."""

JUDGED: Final = ("all", "each")
"""Values of ``judge``: "all" judges the pooled samples, "each" every recording as well."""

LARGEST_FILE: Final = 1_000_000
"""Size of the largest file that is read [bytes]."""


class LimitsError(CdrjError):
    """An invalid file of limits."""


@dataclass(frozen=True)
class Limit:
    """Bounds on one figure of the channels that match a pattern."""

    pattern: str
    """A channel's name, which may contain the wildcards ``*``, ``?`` and ``[...]``; or a quantity
    alone ("tension"), which denotes the mean over its channels."""
    figure: str
    """One of LIMITED."""
    least: float | None = None
    most: float | None = None


@dataclass(frozen=True)
class Limits:
    """The content of one file."""

    source: str
    """Name of the file."""
    limits: tuple[Limit, ...]
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
    """Read a file of limits.

    Raises:
        LimitsError: with one line that names the key, what was given and what is allowed.
    """
    try:
        data = Path(path).read_bytes()
        text = data[: LARGEST_FILE + 1].decode()
    except OSError as error:
        raise LimitsError(f"{path} cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise LimitsError(f"{path} is not UTF-8 text") from None
    if len(data) > LARGEST_FILE:
        raise LimitsError(f"{path} has {len(data)} bytes and is no file of limits")
    return parse_limits(text, str(path))


def parse_limits(text: str, source: str) -> Limits:
    """The limits of a YAML text: ``channels: {PATTERN: {FIGURE: {min: X, max: X}}}``.

    Raises:
        LimitsError: as ``load_limits``.
    """
    try:
        raw = load_yaml(text, source)
    except YamlError as error:
        raise LimitsError(str(error)) from None
    entries = _mapping(raw, "", ("judge", "channels"), source)
    judged = entries.get("judge", JUDGED[0])
    if judged not in JUDGED:
        raise LimitsError(f"judge must be one of {', '.join(JUDGED)}, got {judged!r} ({source})")
    channels = _mapping(entries.get("channels"), "channels", None, source)
    limits = []
    for pattern, figures in channels.items():
        where = f"channels.{pattern}"
        _require_quantity(pattern, where, source)
        for figure, bounds in _mapping(figures, where, LIMITED, source).items():
            limits.append(_limit(pattern, figure, bounds, f"{where}.{figure}", source))
    if not limits:
        raise LimitsError(f"channels names no limit ({source})")
    return Limits(source, tuple(limits), judged == "each")


def check_limits(limits: Limits, errors: Errors) -> LimitCheck:
    """Compare the figures with their limits; an unknown figure counts as outside."""
    judged = [("all recordings", errors.pooled)]
    if len(errors.bags) == 1:
        judged = [(errors.bags[0].path, errors.pooled)]
    elif limits.each:
        judged += [(bag.path, own) for bag, own in zip(errors.bags, errors.of_bags, strict=True)]
    checked = 0
    outside: list[Outside] = []
    for where, figures in judged:
        for limit in limits.limits:
            count, found = _check(limit, where, _matching(limit.pattern, figures))
            checked += count
            outside += found
    return LimitCheck(limits.source, checked, tuple(outside))


def _check(
    limit: Limit, where: str, matching: Mapping[str, ChannelError]
) -> tuple[int, list[Outside]]:
    """Number of checked figures, and those outside; a pattern without a match is outside."""
    checked, outside = 0, []
    for bound, least in ((limit.least, True), (limit.most, False)):
        if bound is None:
            continue
        checked += max(len(matching), 1)
        if not matching:
            outside.append(Outside(where, limit.pattern, limit.figure, None, bound, least))
        for name, error in matching.items():
            value = getattr(error, limit.figure)
            if value is None or (value < bound if least else value > bound):
                outside.append(Outside(where, name, limit.figure, value, bound, least, error.unit))
    return checked, outside


def _matching(pattern: str, errors: Mapping[str, ChannelError]) -> dict[str, ChannelError]:
    if pattern in QUANTITIES:
        members = [error for name, error in errors.items() if quantity_of(name) == pattern]
        return {pattern: mean_over_channels(members)} if members else {}
    return {name: error for name, error in errors.items() if fnmatchcase(name, pattern)}


def _limit(pattern: str, figure: str, bounds: Any, where: str, source: str) -> Limit:
    given = _mapping(bounds, where, ("min", "max"), source)
    for key, value in given.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value):
            raise LimitsError(f"{where}.{key} must be a finite number, got {value!r} ({source})")
    if not given:
        raise LimitsError(f"{where} needs min, max or both ({source})")
    least, most = given.get("min"), given.get("max")
    if least is not None and most is not None and least > most:
        raise LimitsError(f"{where}.min must be at most max = {most:g}, got {least:g} ({source})")
    return Limit(pattern, figure, least, most)


def _mapping(value: Any, where: str, known: Sequence[str] | None, source: str) -> dict[str, Any]:
    """Check that the value is a mapping with only known keys (None: any keys) and return it."""
    if not isinstance(value, dict):
        wanted = f"a mapping of {', '.join(known)}" if known else "a mapping"
        raise LimitsError(f"{where or 'the file'} must be {wanted}, got {_shown(value)} ({source})")
    for key in value:
        path = " ".join((f"{where}.{key}" if where else str(key)).split())
        if not isinstance(key, str):
            raise LimitsError(f"{path} must be text, got {_shown(key)} ({source})")
        if known is not None and key not in known:
            close = get_close_matches(key, known, n=1)
            hint = f"did you mean {close[0]!r}?" if close else f"known keys: {', '.join(known)}"
            raise LimitsError(f"{path} is not a known key; {hint} ({source})")
    return value


def _require_quantity(pattern: str, where: str, source: str) -> None:
    prefix = pattern.partition("/")[0]
    if prefix not in QUANTITIES and not any(character in prefix for character in "*?["):
        known = ", ".join(f"{key}, {key}/…" for key in QUANTITIES)
        raise LimitsError(
            f"{' '.join(where.split())} names no channel; names are {known} ({source})"
        )


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
