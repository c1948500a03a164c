"""What the quick check accepts, jsonschema accepts as well."""

from __future__ import annotations

import json
from copy import deepcopy
from pathlib import Path
from random import Random
from typing import Any

import pytest

from cdrj_ros.robot.document import complaints, parse_document
from cdrj_ros.robot.quick_check import quick_check

ROOT = Path(__file__).parents[2]
SCHEMA = json.loads((ROOT / "cdrj_ros" / "robot" / "robot.schema.json").read_text("utf-8"))
FILES = sorted((ROOT / "config" / "robots").glob("*.yaml"))
CORRELATED = 4
"""Numbers whose correlations are kept; the matrix of all would be most of a document."""
STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 1.0, -1.0, 2, 0.5, 1e16, -1e308, 10**400, float("nan"),
    float("inf"), -float("inf"), "", "a", "a b", "a\n", "ccw", "elbow", "winch", "sphere", "x" * 61,
    [], {}, [[]], [1, 2], [1, 2, 3], [True, 1], {"joint": "elbow"}, [{"type": "anchor"}],
)  # fmt: skip


def containers(value: Any) -> list[Any]:
    inside = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [value for _ in range(bool(inside))] + [
        deep for one in inside for deep in containers(one)
    ]


def mutate(document: Any, rng: Random) -> None:
    """Replace, delete, rename, repeat or exchange one entry."""
    everything = containers(document)
    place = rng.choice(everything)
    key = rng.choice(list(place)) if isinstance(place, dict) else rng.randrange(len(place))
    kind = rng.randrange(5)
    if kind == 0:
        del place[key]
    elif kind == 1 and isinstance(place, dict):
        place[rng.choice(("radius", "type", "joint", "name", "stddev", "x"))] = place[key]
    elif kind == 2 and isinstance(place, list):
        place.append(deepcopy(place[key]))
    elif kind == 3:
        place[key] = deepcopy(rng.choice(everything))
    else:
        place[key] = deepcopy(rng.choice(STRANGE))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_quick_check_accepts_a_robot_file_and_nothing_that_violates_the_schema(
    path: Path,
) -> None:
    satisfied, rng = quick_check(SCHEMA), Random(path.stem)
    sound = parse_document(path.read_text("utf-8"), str(path))
    assert satisfied(sound)
    correlation = sound.get("uncertainty", {}).get("correlation", [])
    correlation[:] = [row[:CORRELATED] for row in correlation[:CORRELATED]]
    verdicts = []
    for _ in range(150):
        document = deepcopy(sound)
        mutate(document, rng)
        verdicts.append(satisfied(document))
        assert not (verdicts[-1] and list(complaints(document, SCHEMA)))
    assert 0 < sum(verdicts) < len(verdicts)


@pytest.mark.parametrize("name", SCHEMA["$defs"])
def test_the_quick_check_of_a_part_accepts_nothing_that_violates_its_rules(name: str) -> None:
    rules = {**SCHEMA["$defs"][name], "$defs": SCHEMA["$defs"]}
    accepted = list(filter(quick_check(rules), STRANGE))
    assert not [value for value in accepted if list(complaints(value, rules))]


@pytest.mark.parametrize(
    "rules",
    [
        {"type": "null"},
        {"not": {}},
        {"type": "string", "format": "date"},
        {"type": "number", "multipleOf": 2},
        {"type": "array", "items": {"type": "number"}, "uniqueItems": True},
        {"type": "object", "patternProperties": {}},
        {"allOf": [{"if": {"required": ["type"]}, "then": {}}]},
        {},
    ],
    ids=str,
)
def test_a_schema_with_other_rules_has_no_quick_check(rules: dict[str, Any]) -> None:
    with pytest.raises((ValueError, LookupError)):
        quick_check(rules)
