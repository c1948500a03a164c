"""A robot with moved points is the robot of a file in which they stand there."""

import numpy as np
import pytest
from support.places import ROBOTS

from cdrj_ros.model.prepared import load_model, mover_of, prepare
from cdrj_ros.robot.parameters import matching_paths, number_at, with_numbers
from cdrj_ros.robot.reader import build_robot

SPRING = """
name: spring
motors: []
joints: [{name: q, range: [-1, 1]}, {name: f, coupled: {q: 0.5}}]
frames: [{name: arm, motion: revolute, joint: q, origin: [0.08, 0, 0], axis: [0, 0, 1]},
         {name: tip, parent: arm, motion: revolute, joint: f, origin: [0.03, 0, 0],
          axis: [0, 0, 1]}]
cables:
  - {name: c, axial_stiffness: 30, rest_length: 0.05, nodes: [
      {type: anchor, position: [0, 0.02, 0]}, {type: anchor, frame: tip, position: [0.02, 0, 0]}]}
"""


@pytest.mark.parametrize("name", ["finger3d", "wrist", "spring"])
def test_moved_points_give_the_constants_of_a_file_with_them(name, tmp_path):
    path = ROBOTS / f"{name}.yaml"
    if name == "spring":
        path = tmp_path / "spring.yaml"
        path.write_text(SPRING)
    model = load_model(str(path))
    moved, document = mover_of(model), {**model.robot.document}
    for pattern in ("cables.*.nodes.*.position.*", "frames.*.origin.*"):
        ((*paths,),) = matching_paths(document, pattern)
        for one in paths:
            changed = with_numbers(document, {one: number_at(document, one) + 1e-4})
            whole = prepare(build_robot(changed, "moved"), check_range=False)
            found = moved({one: 1e-4})
            np.testing.assert_allclose(found.constants, whole.constants, rtol=1e-12, atol=1e-15)
            assert [cable.preload for cable in found.robot.cables] == pytest.approx(
                [cable.preload for cable in whole.robot.cables], rel=1e-12
            )
    assert moved({"friction.mu_c": 0.1}) is None
