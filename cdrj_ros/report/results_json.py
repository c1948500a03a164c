"""Comparisons as a JSON file, for continuous integration, spreadsheets and other tools.

``{"format", "version", "bags": [{"path", "duration_s", "channels", "friction", "counters",
"notes", "facts", "health"}], "all": {"channels"}, "limits"}`` where ``channels`` maps a channel's
name to its ``unit``, ``n`` and the figures of ChannelError, ``friction`` a pulley's name to the
figures of PulleyFriction, ``health`` is null or the verdict of the health monitor, and ``limits``
is null or ``{"file", "checked", "outside": [{"where", "channel", "figure", "value", "min" or "max",
"by"}]}``.  An unknown figure is null; NaN and infinity never appear.
docs/recordings.md describes every key.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final, TypeAlias

from cdrj_ros.evaluation.channels import unit_of
from cdrj_ros.evaluation.limits import LimitCheck
from cdrj_ros.evaluation.metrics import FIGURES, ChannelError, Errors
from cdrj_ros.foundation.files import write_text

FORMAT: Final = "cdrj_ros/validation"
VERSION: Final = 2
"""Incremented when a key changes its meaning or is removed, but not for new keys."""

FRICTION_FIGURES: Final = ("mean", "largest", "mean_share", "largest_share")

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"


def results(errors: Errors, limit_check: LimitCheck | None = None) -> dict[str, Json]:
    """Content of the file written by ``write_results``, as plain lists and dictionaries.

    ``all`` holds the figures of the pooled samples of all recordings.
    """
    bags: list[Json] = [
        {
            "path": bag.path,
            "duration_s": _finite(bag.duration_s),
            "channels": _channels(own),
            "friction": {
                one.name: {name: _finite(getattr(one, name)) for name in FRICTION_FIGURES}
                for one in bag.friction
            },
            "counters": {cause: int(n) for cause, n in bag.counters.items()},
            "notes": list(bag.notes),
            "facts": dict(bag.facts),
            "health": _plain(asdict(bag.health)) if bag.health else None,
        }
        for bag, own in zip(errors.bags, errors.of_bags, strict=True)
    ]
    return {
        "format": FORMAT,
        "version": VERSION,
        "bags": bags,
        "all": {"channels": _channels(errors.pooled)},
        "limits": None if limit_check is None else _limits(limit_check),
    }


def write_results(
    path: str | os.PathLike[str], errors: Errors, limit_check: LimitCheck | None = None
) -> None:
    """Write the figures as JSON atomically.

    Raises:
        OSError: the file cannot be written; an existing file is then kept.
    """
    text = json.dumps(results(errors, limit_check), indent=2, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def _channels(errors: Mapping[str, ChannelError]) -> dict[str, Json]:
    return {
        name: {
            "unit": error.unit or unit_of(name),
            "n": error.n,
            **{figure: _finite(getattr(error, figure)) for figure in FIGURES},
        }
        for name, error in errors.items()
    }


def _limits(limit_check: LimitCheck) -> dict[str, Json]:
    outside: list[Json] = [
        {
            "where": one.where,
            "channel": one.channel,
            "figure": one.figure,
            "value": _finite(one.value),
            "min" if one.least else "max": one.bound,
            "by": _finite(one.by),
        }
        for one in limit_check.outside
    ]
    return {"file": limit_check.source, "checked": limit_check.checked, "outside": outside}


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _plain(value: Any) -> Json:
    """A value of dataclasses with lists for tuples, and null for numbers that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    return _finite(value) if isinstance(value, float) else value
