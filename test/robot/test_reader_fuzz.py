"""Damaged robot files give a robot that can be stepped or a one-line error, without delay.

Of every kind of damage, ``make soak`` tries CDRJ_DAMAGES times as many.
"""

import os
from copy import deepcopy
from random import Random
from time import process_time
from unittest.mock import patch

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.estimation.estimator import Sample, initial_state, step
from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.yaml import load_yaml
from cdrj_ros.model.packing import INVALID
from cdrj_ros.model.prepared import prepare
from cdrj_ros.robot.reader import parse_robot
from cdrj_ros.robot.writer import with_section

FILES = sorted(ROBOTS.glob("*.yaml"))
MOST_SECONDS = 20.0
"""Limit of CPU time, which is independent of other load on the machine [s]."""
TIMES = int(os.environ.get("CDRJ_DAMAGES", "1"))
STRANGE = (
    None, True, False, 0, -1, 1, 2, 1e-300, 5e-324, 1e14, -1e14, 1e16, 1e308, float("nan"),
    float("inf"), -float("inf"), "", "a", "1e3", "elbow", "winch", "\n", "x" * 5000, [], {}, [[]],
    [1, 2], {"joint": "elbow"}, {"joint": "elbow", "angle": [0, 1], "value": [1, 1]},
    {"joint": "nobody", "slope": 1}, [[[[[[[[1]]]]]]]], {"a": {"b": {"c": {}}}},
)  # fmt: skip


def text_of(path):
    """A robot's file without a matrix of correlations, which would be most of it."""
    text = path.read_text("utf-8")
    return with_section(text, "uncertainty", None) if "correlation" in text else text


def containers(document):
    """All mappings and lists in a document, in which some may occur more than once."""
    found = {}
    waiting = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, (dict, list)) and value and id(value) not in found:
            found[id(value)] = value
            waiting += value.values() if isinstance(value, dict) else value
    return list(found.values())


def mutate(document, rng):
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


def follow(model):
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


def judge(document, source):
    """Whether a document is a valid robot; fails unless it is one or gives a one-line error."""
    begin = process_time()
    try:
        with patch("cdrj_ros.robot.document.load_yaml", lambda *_: document):  # parsing is slow
            model = prepare(parse_robot("a document", source))
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
def test_a_damaged_document_is_a_robot_or_one_line(path):
    rng = Random(path.stem)
    verdicts = []
    sound = load_yaml(text_of(path), str(path))
    assert judge(deepcopy(sound), str(path))
    for _ in range(30 * TIMES):
        document = deepcopy(sound)
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            mutate(document, rng)
        verdicts.append(judge(document, str(path)))
    assert 0 < sum(verdicts) < len(verdicts)
