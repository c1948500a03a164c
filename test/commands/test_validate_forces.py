"""validate compares nodal forces as vectors where the reference has components."""

import json

import numpy as np
import pytest

from cdrj_ros.commands import simulate, validate
from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.evaluation.inputs import condition_recording
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.writer import BagWriter

DEGREES = 7.5
CHORD = 2.0 * np.sin(np.radians(DEGREES) / 2.0)
"""Relative vector error of a force turned by DEGREES."""


def turned_bag(folder, robot, frame_id):
    """Two seconds of the rig whose recorded forces are the estimates, turned in the plane."""
    inputs, topics, model = folder / "inputs", Topics(), load_model(robot)
    words = ["--duration", "2", "--cells", "1"]
    assert simulate.main([str(inputs), "--robot", "prototype", *words]) == 0
    estimates = estimate(model, condition_recording(model, read_recording(inputs)))
    layout = model.layout
    x, y = estimates.values[:, layout.force_x], estimates.values[:, layout.force_y]
    cosine, sine = np.cos(np.radians(DEGREES)), np.sin(np.radians(DEGREES))
    with BagWriter(folder / "turned") as bag:
        bag.copy(inputs, [topics.motors, topics.joints])
        bag.write_nodal_forces(
            topics.references[1], estimates.stamp_ns, layout.pulleys, np.hypot(x, y),
            force_x=cosine * x - sine * y, force_y=sine * x + cosine * y,
            force_z=np.zeros_like(x), frame_id=frame_id,
        )  # fmt: skip
    return folder / "turned"


@pytest.mark.parametrize(
    ("robot", "frame_id"),
    [("prototype", ""), ("prototype", "base"), ("prototype_positions", "base")],
)
def test_a_turned_force_is_seen_where_both_vectors_are_in_one_frame(
    robot, frame_id, tmp_path, capsys
):
    out, bag = tmp_path / "figures.json", turned_bag(tmp_path, robot, frame_id)
    assert validate.main([str(bag), "--robot", robot, "--json", str(out)]) == 0
    figures = json.loads(out.read_text())
    channels, notes = figures["all"]["channels"], figures["bags"][0]["notes"]
    magnitudes = [one for name, one in channels.items() if name.startswith("nodal_force/")]
    vectors = [one for name, one in channels.items() if name.startswith("force_vector/")]
    assert len(magnitudes) == 14
    assert max(one["mean_relative_error"] for one in magnitudes) < 1e-12
    if (robot, frame_id) == ("prototype", "base"):  # whose file gives no positions
        assert not vectors
        assert notes[0].startswith("The recorded forces are in the frame base, but the robot file")
        return
    assert notes == []
    assert len(vectors) == 14
    for one in vectors:
        assert one["max_direction_error_deg"] == pytest.approx(DEGREES, rel=1e-9)
        assert one["mean_relative_error"] == pytest.approx(CHORD, rel=1e-9)
    assert "Force vector [N]" in capsys.readouterr().out
