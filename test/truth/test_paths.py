"""Laws of the paths of cables over bodies."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path as File

import numpy as np
import pytest

from truth import robots
from truth.bodies import Node
from truth.frames import Frame, place
from truth.paths import find_path
from truth.scenes import Scene

BASE = place((), (), np.zeros((1, 0)))
AXIS = (0.0, 0.0, 1.0)


def test_a_helix_is_a_straight_line_on_the_unrolled_cylinder() -> None:
    r, a, b = 0.03, (-0.2, 0.0, 0.0), (0.2, 0.0, 0.15)
    nodes = (Node("anchor", a), Node("cylinder", (0, 0, 0), radius=r, axis=AXIS, turn=-1),
             Node("anchor", b))  # fmt: skip
    path = find_path(nodes, BASE)
    flat = 2.0 * np.sqrt(0.2**2 - r**2) + r * (np.pi - 2.0 * np.arccos(r / 0.2))
    assert path.length[0] == pytest.approx(np.hypot(flat, 0.15), rel=1e-12)


def test_a_cable_over_a_sphere_takes_the_great_circle() -> None:
    r, a, b = 0.03, np.array([-0.2, 0.01, 0.0]), np.array([0.15, 0.0, 0.02])
    nodes = (Node("anchor", tuple(a)),
             Node("sphere", (0, 0, 0), radius=r, side=(0.0, 0.1, 0.0)),
             Node("anchor", tuple(b)))  # fmt: skip
    path = find_path(nodes, BASE)
    sizes = np.linalg.norm([a, b], axis=1)
    wrap = np.arccos(a @ b / sizes.prod()) - np.arccos(r / sizes).sum()
    assert path.wrap[0, 0] == pytest.approx(wrap, rel=1e-9)
    assert path.length[0] == pytest.approx(np.sqrt(sizes**2 - r**2).sum() + r * wrap, rel=1e-12)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_the_surface_passes_under_a_path_that_stands_still(kind: str) -> None:
    r, turned, shifted = 0.03, np.linspace(0.0, 0.5, 51), np.linspace(0.0, 0.02, 51)
    frames = (
        Frame("turning", "base", "revolute", "turn"),
        Frame("body", "turning", "prismatic", "shift", axis=AXIS),
    )
    joint = np.stack([turned, shifted * (kind == "cylinder")], axis=1)
    body = Node(kind, (0, 0, 0), frame="body", radius=r, axis=AXIS, turn=1)
    rise = 0.1
    if kind == "sphere":
        body, rise = replace(body, axis=None, side=(0.0, -0.1, 0.0)), 0.0
        joint[:, 0] *= 0.5  # its side turns with it
    nodes = (Node("anchor", (-0.2, -0.005, 0.0)), body, Node("anchor", (0.15, -0.005, rise)))
    path = find_path(nodes, place(frames, ("turn", "shift"), joint))
    assert np.ptp(path.length) < 1e-12
    lean = np.arcsin(path.direction[0, 0, 2])
    along = -np.cos(lean) * r * joint[:, 0] - np.sin(lean) * joint[:, 1]
    for ends in (path.first, path.last):
        np.testing.assert_allclose(ends[:, 0] - ends[0, 0], along, atol=1e-9)


@pytest.mark.parametrize(
    "scene",
    [robots.skew_cylinders(3.0, 500), robots.sphere(3.0, 500), robots.arm(3.0, 500)],
    ids=lambda scene: scene.name,
)
def test_a_path_lengthens_only_by_the_motion_of_the_bodies_at_the_ends_of_its_spans(
    scene: Scene,
) -> None:
    # the first variation of a shortest path; differences are blunt where the sphere is left
    frames = scene.poses
    rate = np.gradient(scene.joint, scene.time, axis=0)
    for line, path in zip(scene.lines, scene.paths, strict=True):
        opened = np.zeros(scene.time.size)
        for k in range(len(line.nodes) - 1):
            begin = frames[line.nodes[k].frame].velocity(path.begin[:, k], len(scene.joints))
            end = frames[line.nodes[k + 1].frame].velocity(path.end[:, k], len(scene.joints))
            opened += np.einsum("njx,nx,nj->n", end - begin, path.direction[:, k], rate)
        change = np.gradient(path.length, scene.time)
        inner = slice(2, -2)
        np.testing.assert_allclose(
            change[inner], opened[inner], atol=1e-3 * np.abs(opened).max(), err_msg=line.name
        )


def test_the_truth_imports_nothing_of_what_it_tests() -> None:
    for name in ("frames", "bodies", "paths", "surface", "scenes", "robots"):
        tree = ast.parse((File(__file__).parent / f"{name}.py").read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            modules += [a.name for a in node.names] if isinstance(node, ast.Import) else []
            assert not any(module.split(".")[0] == "cdrj_ros" for module in modules), name
