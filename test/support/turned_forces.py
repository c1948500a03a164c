"""Bags whose recorded nodal forces are the estimates, turned by a known angle."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.evaluation.inputs import condition_recording
from cdrj_ros.model.loading import load_model
from cdrj_ros.recordings import BagWriter, Topics, read_recording

ROOT = Path(__file__).parents[2]
ROBOT = ROOT / "config" / "robots" / "prototype.yaml"
SAMPLE = ROOT / "bags" / "prototype_preload_36_26"


def turned_bag(
    folder: Path,
    degrees: float,
    *,
    seconds: float = 2.0,
    robot: Path = ROBOT,
    frame_id: str = "",
) -> Path:
    """The beginning of the sample recording, with nodal forces turned in the plane as references.

    Args:
        folder: where the bag is written.
        degrees: counterclockwise angle from the estimated to the recorded force [°].
        seconds: length of the bag [s].
        robot: robot file of the estimates.
        frame_id: of the messages with the forces.
    """
    whole, topics = read_recording(SAMPLE), Topics()
    until = whole.start_ns + round(seconds * 1e9)

    def write_inputs(bag: BagWriter) -> None:
        for topic, axes in ((topics.motors, whole.motors), (topics.joints, whole.joints)):
            for name, series in axes.items():
                kept = series.stamp_ns < until
                bag.write_joint_states(
                    topic, series.stamp_ns[kept], [name], position=series.value[kept, None]
                )

    with BagWriter(folder / "inputs") as bag:
        write_inputs(bag)
    model = load_model(str(robot))
    estimates = estimate(model, condition_recording(model, read_recording(folder / "inputs")))
    layout = model.layout
    x, y = estimates.values[:, layout.force_x], estimates.values[:, layout.force_y]
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    arrays = {
        "force_x": cosine * x - sine * y,
        "force_y": sine * x + cosine * y,
        "force_z": np.zeros_like(x),
        "magnitude": np.hypot(x, y),
    }
    with BagWriter(folder / "turned") as bag:
        write_inputs(bag)
        bag.write_nodal_forces(
            topics.references[1],
            estimates.stamp_ns,
            layout.pulleys,
            frame_id=frame_id,
            **arrays,
        )
    return folder / "turned"
