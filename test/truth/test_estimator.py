"""The estimator beside the truth.

The estimator lets the friction of an arc act in the middles of a few cells that move along with it;
many cells leave next to nothing of the difference.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path as File

import numpy as np
import pytest

from truth import robots
from truth.comparison import compare
from truth.scenes import Scene, Truth

SCENES = {
    "skew_cylinders": lambda: robots.skew_cylinders(9.0, 62.5),
    "sphere": lambda: robots.sphere(20.0, 50),
    "carriage": lambda: robots.carriage(10.0, 62.5),
    "platform": lambda: robots.platform(10.0, 75),
    "sheath_157": lambda: robots.sheath(np.radians(157.0), 9.0, 62.5),
}


@cache
def known(name: str) -> tuple[Scene, Truth]:
    scene = SCENES[name]()
    return scene, scene.truth()


@pytest.mark.parametrize("name", SCENES)
def test_tensions_and_efforts_are_those_of_cells_on_the_surfaces(name: str) -> None:
    found = compare(*known(name))
    assert found.mean <= 0.001
    assert found.joint_effort <= 0.005
    assert found.motor_effort <= 0.005


@pytest.mark.parametrize("name", SCENES)
def test_many_contacts_a_body_give_the_truth_itself(name: str) -> None:
    found = compare(*known(name), cells=12)
    assert found.mean <= 0.0002
    assert found.largest <= 0.05
    assert found.joint_effort <= 0.001
    assert found.motor_effort <= 0.001


def test_the_truth_imports_nothing_of_what_it_tests() -> None:
    for name in ("frames", "bodies", "paths", "surface", "scenes", "robots"):
        tree = ast.parse((File(__file__).parent / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            modules += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            assert not any(module.split(".")[0] == "cdrj_ros" for module in modules), name
