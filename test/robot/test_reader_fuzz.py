"""Damaged robot files give a robot that can be stepped or a one-line error, without delay.

Of every kind of damage, ``make soak`` tries CDRJ_DAMAGES times as many.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from random import Random
from time import process_time
from typing import Any

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.estimation.estimator import initial_state, step
from cdrj_ros.estimation.samples import Sample
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.yaml import load_yaml
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.model.state import INVALID
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.writer import with_section

FILES = sorted(ROBOTS.glob("*.yaml"))
MOST_SECONDS = 20.0
"""Limit of CPU time, which is independent of other load on the machine [s]."""
TIMES = int(os.environ.get("CDRJ_DAMAGES", "1"))
STRANGE: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 1e-300, 5e-324, 1e14, -1e14, 1e16, 1e308, float("nan"),
    float("inf"), -float("inf"), "", "a", "1e3", "elbow", "winch", "\n", "x" * 5000, [], {}, [[]],
    [1, 2], {"joint": "elbow"}, {"joint": "elbow", "angle": [0, 1], "value": [1, 1]},
    {"joint": "nobody", "slope": 1}, [[[[[[[[1]]]]]]]], {"a": {"b": {"c": {}}}},
)  # fmt: skip


def text_of(path: Path) -> str:
    """A robot's file without a matrix of correlations, which would be most of it."""
    text = path.read_text("utf-8")
    return with_section(text, "uncertainty", None) if "correlation" in text else text


def containers(document: Any) -> list[Any]:
    """All mappings and lists in a document, in which some may occur more than once."""
    found: dict[int, Any] = {}
    waiting = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, (dict, list)) and value and id(value) not in found:
            found[id(value)] = value
            waiting += value.values() if isinstance(value, dict) else value
    return list(found.values())


def mutate(document: Any, rng: Random) -> None:
    """Change one random entry: delete, replace, scale, duplicate, shuffle, rename or swap it."""
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
        place[key] = deepcopy(rng.choice(everything))
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


@pytest.fixture
def judge_document(monkeypatch: pytest.MonkeyPatch) -> Callable[[Any, str], bool]:
    """As ``judge``, for what a YAML file holds: parsing takes seven times as long as the rest."""

    def judged(document: Any, source: str) -> bool:
        monkeypatch.setattr("cdrj_ros.robot.document.load_yaml", lambda *_: document)
        return judge("a document", source)

    return judged


def follow(model: Model) -> None:
    """Step the estimator three times; valid tensions must be finite and not negative."""
    robot, state = model.robot, initial_state(model)
    motors = robot.reference_motors
    joints = robot.reference_pose
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
    sound = load_yaml(text_of(path), str(path))
    assert judge_document(deepcopy(sound), str(path))
    for _ in range(20 * TIMES):
        document = deepcopy(sound)
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            mutate(document, rng)
        verdicts.append(judge_document(document, str(path)))
    assert 0 < sum(verdicts) < len(verdicts)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_damaged_text_is_a_robot_or_one_line(path: Path) -> None:
    rng = Random(path.stem)
    text = text_of(path)
    assert judge(text, str(path))
    verdicts = [judge(damaged_text(text, rng), str(path)) for _ in range(12 * TIMES)]
    assert not all(verdicts)


HUGE = (1e200, -1e200, 10**290, float("inf"), float("nan"))


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_absurd_number_anywhere_is_one_line(
    path: Path, judge_document: Callable[[Any, str], bool]
) -> None:
    rng = Random(path.stem)
    sound = load_yaml(text_of(path), str(path))
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
