"""Comparisons as a JSON file, for programs: a team's CI, a spreadsheet, another tool.

``{"bags": [{"path", "duration_s", "channels", "counters", "notes", "facts"}],
"all": {"channels"}}`` where ``channels`` maps a channel's name to its ``unit``, ``n`` and the figures of ChannelError.
A figure that cannot be given is null; NaN and infinity never appear.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from cdrj_ros.estimation.comparison import BagComparison, unit_of
from cdrj_ros.estimation.metrics import ChannelError, bag_errors, pooled_errors
from cdrj_ros.report.files import write_text

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"


def results(comparisons: Sequence[BagComparison]) -> dict[str, Json]:
    """What ``write_results`` writes, as plain lists and dictionaries.

    ``all`` holds the figures of the joined samples of every recording.
    """
    return {
        "bags": [
            {
                "path": comparison.path,
                "duration_s": _finite(comparison.duration_s),
                "channels": _channels(bag_errors(comparison)),
                "counters": {cause: int(n) for cause, n in comparison.counters.items()},
                "notes": list(comparison.notes),
                "facts": dict(comparison.facts),
            }
            for comparison in comparisons
        ],
        "all": {"channels": _channels(pooled_errors(comparisons))},
    }


def write_results(path: str | os.PathLike[str], comparisons: Sequence[BagComparison]) -> None:
    """Write the comparisons as JSON, whole or not at all.

    Raises:
        OSError: the file cannot be written; an older one is then untouched.
    """
    text = json.dumps(results(comparisons), indent=2, ensure_ascii=False, allow_nan=False)
    write_text(path, text + "\n")


def _channels(errors: Mapping[str, ChannelError]) -> dict[str, Json]:
    return {
        name: {
            "unit": unit_of(name),
            **{figure: _finite(value) for figure, value in dataclasses.asdict(error).items()},
        }
        for name, error in errors.items()
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
