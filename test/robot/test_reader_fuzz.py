"""Damaged robot files give a robot that can be stepped or a one-line error, without delay.

Of every kind of damage, ``make soak`` tries CDRJ_DAMAGES times as many.
"""

from __future__ import annotations

import json
import os
import re
from collections import Counter
from collections.abc import Callable
from copy import deepcopy
from datetime import date
from pathlib import Path
from random import Random
from time import process_time
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.yaml import load_yaml
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.model.status import INVALID
from cdrj_ros.robot.reader import parse_robot

FILES = sorted((Path(__file__).parents[2] / "config" / "robots").glob("*.yaml"))
MOST_SECONDS = 20.0
"""Limit of CPU time, which is independent of other load on the machine [s]."""
TIMES = int(os.environ.get("CDRJ_DAMAGES", "1"))
STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 1e-300, 5e-324, 1e14, -1e14, 1e16, 1e308, 10**400, float("nan"),
    float("inf"), -float("inf"), "", "a", "1e3", "elbow", "winch", "\n", "x" * 5000, [], {}, [[]],
    [1, 2], {"joint": "elbow"}, {"joint": "elbow", "angle": [0, 1], "value": [1, 1]},
    {"joint": "nobody", "slope": 1}, [[[[[[[[1]]]]]]]], {"a": {"b": {"c": {}}}},
)  # fmt: skip


CORRELATED = 8
NOT_JSON = {"NaN": ".nan", "Infinity": ".inf", "-Infinity": "-.inf"}


def containers(document: Any) -> list[Any]:
    """All mappings and lists in a document that may contain itself."""
    found: dict[int, Any] = {}
    waiting = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, (dict, list)) and value and id(value) not in found:
            found[id(value)] = value
            waiting += value.values() if isinstance(value, dict) else value
    return list(found.values())


def mutate(document: Any, rng: Random) -> None:
    """Change one random entry: delete, replace, scale, duplicate, shuffle, rename or alias it."""
    everything = containers(document)
    place = rng.choice(everything)
    key = rng.choice(list(place)) if isinstance(place, dict) else rng.randrange(len(place))
    value = place[key]
    kind = rng.randrange(8)
    if kind == 0:
        del place[key]
    elif kind == 1:
        place[key] = rng.choice(STRANGE)
    elif kind == 2 and isinstance(value, (int, float)):
        place[key] = value * rng.choice((-1, 0, 1e-12, 1e-3, 0.5, 2, 1e3, 1e12))
    elif kind == 3 and isinstance(place, list):
        place.append(value)
    elif kind == 4:
        place[key] = rng.choice(everything)  # an alias, possibly of an enclosing container
    elif kind == 5 and isinstance(place, dict):
        place[rng.choice(("radius", "wrap_angle", "joint", "name", "x", f"{key}_mm"))] = value
    elif kind == 6 and isinstance(place, list):
        rng.shuffle(place)
    else:
        place[key] = [value] if rng.randrange(2) else str(value)


def damaged_text(text: str, rng: Random) -> str:
    """Damage the text: insert, delete or replace characters, duplicate lines, or truncate."""
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(text))
        kind = rng.randrange(5)
        if kind == 0:
            text = text[:at] + rng.choice("{}[]:,#&*!|>'\"%@`-?\t\n\0\x07é") + text[at:]
        elif kind == 1:
            text = text[:at] + text[at + rng.randrange(1, 40) :]
        elif kind == 2:
            lines = text.split("\n")
            line = rng.randrange(len(lines))
            lines.insert(line, lines[rng.randrange(len(lines))])
            text = "\n".join(lines)
        elif kind == 3:
            text = text[: max(at, 1)]
        else:
            text = text[:at] + rng.choice("0123456789.eE+-") + text[at + 1 :]
    return text


def whole(path: Path) -> Any:
    """A robot's document with the correlations of a few numbers only.

    The matrix of all would be most of the document: entries elsewhere would hardly be damaged, and
    reading it would take most of the time.
    """
    document = YAML(typ="safe", pure=True).load(path.read_text("utf-8"))
    unsure = document.get("uncertainty", {})
    if "correlation" in unsure:
        for key in ("parameters", "stddev"):
            unsure[key] = unsure[key][:CORRELATED]
        unsure["correlation"] = [row[:CORRELATED] for row in unsure["correlation"][:CORRELATED]]
    return document


def whole_text(path: Path) -> str:
    """A robot's file with the correlations of a few numbers only, for the same reason."""

    def fewer(found: re.Match[str]) -> str:
        return f"[{','.join(found[1].split(',')[:CORRELATED])}]"

    def rows(found: re.Match[str]) -> str:
        return found[1] + "".join(
            re.findall(r"    - (?:\[[^]]*\]|[^\[\n]*)\n", found[2])[:CORRELATED]
        )

    text = path.read_text("utf-8")
    before, begin, unsure = text.partition("\nuncertainty:")
    unsure = re.sub(r"(  (?:parameters|correlation):\n)((?:    .*\n)+)", rows, unsure)
    return before + begin + re.sub(r"\[([^]]*)\]", fewer, unsure)


def dumped(document: Any) -> str:
    """The document in flow style, with an alias wherever a container appears again.

    ruamel.yaml needs as long to write a document as to read it.
    """
    inside = [
        value
        for place in containers(document)
        for value in (place.values() if isinstance(place, dict) else place)
    ]
    times = Counter(map(id, (document, *inside)))
    names: dict[int, str] = {}

    def text(value: Any) -> str:
        if not isinstance(value, (dict, list)):
            written = json.dumps(value, ensure_ascii=False, default=str)
            return str(value) if isinstance(value, date) else NOT_JSON.get(written, written)
        if id(value) in names:
            return f"*{names[id(value)]} "
        anchor = ""
        if value and times[id(value)] > 1:
            names[id(value)] = f"a{len(names)}"
            anchor = f"&{names[id(value)]} "
        if isinstance(value, list):
            return f"{anchor}[{', '.join(map(text, value))}]"
        pairs = (f"{text(key)}: {text(each)}" for key, each in value.items())
        return f"{anchor}{{{', '.join(pairs)}}}"

    return text(document)


def needs_text(document: Any) -> bool:
    """Whether only YAML makes of it what the reader gets: aliases, keys that are no text, and
    integers that YAML refuses.
    """
    inside = containers(document)
    values = [v for one in inside for v in (one.values() if isinstance(one, dict) else one)]
    shared = Counter(id(value) for value in (document, *values) if isinstance(value, (dict, list)))
    return (
        max(shared.values()) > 1
        or any(isinstance(value, int) and abs(value) > 1e300 for value in values)
        or any(not isinstance(key, str) for one in inside if isinstance(one, dict) for key in one)
    )


@pytest.fixture
def judge_document(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any, str], bool]:
    """As ``judge``, for a document: what needs no text is given to the reader as YAML reads it.

    Parsing takes seven times as long as all that follows, and test_a_damaged_text is about it.
    """
    given: dict[str, Any] = {}

    def known_or_read(text: str, source: str) -> Any:
        return given[text] if text in given else load_yaml(text, source)

    monkeypatch.setattr("cdrj_ros.robot.document.load_yaml", known_or_read)

    def judged(document: Any, source: str) -> bool:
        if needs_text(document):
            return judge(dumped(document), source)
        given["a document"] = document
        return judge("a document", source)

    return judged


def follow(model: Model) -> None:
    """Step the estimator three times; valid tensions must be finite and not negative."""
    robot, state = model.robot, initial_state(model)
    motors = np.array([motor.reference_angle for motor in robot.motors])
    joints = np.array([joint.reference_angle for joint in robot.joints])
    for k in range(3):
        moved = Sample(10**18 + k * 10**6, motors + 0.01 * k, joints + 0.001 * k)
        state, estimate = step(model, state, moved)
        known = estimate.status.astype(int) & INVALID == 0
        assert np.all(np.isfinite(estimate.tension[known]))
        assert np.all(estimate.tension[known] >= 0.0)


def judge(text: str, source: str = "damaged") -> bool:
    """Whether the text is a valid robot; fails unless it is one or gives a one-line error."""
    begin = process_time()
    try:
        model = prepare(parse_robot(text, source))
    except CdrjError as error:
        words = str(error)
        assert words
        assert len(words.splitlines()) == 1
        assert len(words) < 1000
        assert process_time() - begin < MOST_SECONDS
        return False
    follow(model)
    assert process_time() - begin < MOST_SECONDS
    return True


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_damaged_document_is_a_robot_or_one_line(
    path: Path, judge_document: Callable[[Any, str], bool]
) -> None:
    rng = Random(path.stem)
    verdicts = []
    sound = whole(path)
    assert judge(dumped(sound), str(path))
    for _ in range(20 * TIMES):
        document = deepcopy(sound)
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            mutate(document, rng)
        verdicts.append(judge_document(document, str(path)))
    assert 0 < sum(verdicts) < len(verdicts)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_damaged_text_is_a_robot_or_one_line(path: Path) -> None:
    rng = Random(path.stem)
    text = whole_text(path)
    assert judge(text, str(path))
    verdicts = [judge(damaged_text(text, rng), str(path)) for _ in range(12 * TIMES)]
    assert not all(verdicts)


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [*a, *a]",
        "a: &a {b: *a}",
        "a: &a [1, 1]\nb: &b [*a, *a]\n" + "".join(
            f"{chr(99 + k)}: &{chr(99 + k)} [*{chr(98 + k)}, *{chr(98 + k)}]\n" for k in range(22)
        ),
        "[" * 3000,
        "{a: " * 500 + "1" + "}" * 500,
        "a: !!python/object/apply:os.system ['true']",
        "!!python/object:os.stat_result {}",
        "a: 1\na: 2",
        "? [1, 2]\n: 3",
        "a: 2001-12-14t21:59:43.10-05:00",
        "a: !!binary R0lGODlhDAAMAIQAAP",
        "%YAML 9.9\n---\na: 1",
        "a: 1\n---\nb: 2",
        "\0",
        "\ufeff",
        "name: " + "9" * 5000,
        "a: 0x" + "f" * 5000,
        "a: 1:2:3:4",
        "<<: [1]",
        "name: !!int ''",
        "name: !!float ''",
        "name: !!bool foo",
        "[[a]]: 1",
        "name: \"\\ud800\"",
        "\"\\ud800\": 1",
        "a: &a {k: 1}\n" + "".join(
            f"x{k}: &x{k} {{<<: [*{p}, *{p}, *{p}, *{p}, *{p}]}}\n"
            for k, p in enumerate(["a", *(f"x{k}" for k in range(24))])
        ),
        "a: &a0 [x, x]\n" + "".join(
            f"b{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 30)
        ),
    ],
    ids=range(27),
)  # fmt: skip
def test_a_malicious_text_is_refused_in_one_line(text: str) -> None:
    assert not judge(text)


HUGE = (1e200, -1e200, 10**290, float("inf"), float("nan"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_absurd_number_anywhere_is_one_line(
    path: Path, judge_document: Callable[[Any, str], bool]
) -> None:
    rng = Random(path.stem)
    sound = whole(path)
    for _ in range(10 * TIMES):
        document = deepcopy(sound)
        places = [
            (place, key)
            for place in containers(document)
            for key in (place if isinstance(place, dict) else range(len(place)))
            if type(place[key]) in (int, float)
        ]
        place, key = rng.choice(places)
        place[key] = rng.choice(HUGE)
        assert not judge_document(document, str(path))
