"""Equation (44): rho comes back from recordings of the simulated rig."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path as File
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from support.places import PROTOTYPE

from cdrj_ros.commands import simulate
from cdrj_ros.foundation.errors import UsageError
from cdrj_ros.model.prepared import Model, prepare
from cdrj_ros.recordings.recording import read_recording
from cdrj_ros.robot.reader import load_robot
from cdrj_ros.robot.writer import with_numbers_in_text
from cdrj_ros.simulation.sensors import LoadCells
from examples.paper.propagation import (
    KnownTension,
    Path,
    identify_rho,
    path_of,
    propagate,
    with_rho,
)

RHO = {"upper": 0.1114, "lower": 0.3920}
"""What the source found at the preloads."""
PRELOADS = "23.52,6.66"
"""Of upper and lower [N]."""
NOISE = LoadCells().noise


@dataclass(frozen=True)
class Simulated:
    """Readings of the rig's sensors; the model's rho is deliberately wrong."""

    model: Model
    path: Path
    said: Mapping[str, np.ndarray]
    """Every fourth reading of every channel."""


@cache
def recording():
    numbers = {f"cables.{cable}.friction.rho": rho for cable, rho in RHO.items()}
    text = with_numbers_in_text(PROTOTYPE.read_text("utf-8"), numbers, "robot")
    with TemporaryDirectory() as folder:
        robot, bag = File(folder, "robot.yaml"), File(folder, "bag")
        robot.write_text(text, "utf-8")
        words = ["--preload", PRELOADS, "--duration", "16", "--cells", "4"]
        assert simulate.main([str(bag), "--robot", str(robot), *words]) == 0
        found = read_recording(bag)
    wrong = load_robot(PROTOTYPE)
    for cable in wrong.cables:
        wrong = with_rho(wrong, cable.name, 0.7)
    model, elbow = prepare(wrong), found.joints["elbow"]
    stamps = found.references["tension/upper/8"].stamp_ns[::4]
    said = {name: one.value[::4] for name, one in found.references.items()}
    joint = np.interp(stamps, elbow.stamp_ns, elbow.value)
    return Simulated(model, path_of(model, stamps, joint[:, None]), said)


@pytest.mark.parametrize("cable", RHO)
def test_the_rho_of_the_source_are_recovered(cable):
    rig = recording()
    known = KnownTension(f"{cable}/8", rig.said[f"tension/{cable}/8"], NOISE)
    force = rig.said[f"nodal_force/{cable}/3"]
    found = identify_rho(rig.model, rig.path, known, f"{cable}/3", force)
    assert found.rho == pytest.approx(RHO[cable], abs=0.01)
    assert 0.0 < found.stddev < 0.001, "due to the load cells' noise alone"
    assert found.rms < 0.2, "the rest is the propagated noise of the load cells"
    made = propagate(prepare(with_rho(rig.model.robot, cable, 0.234)), rig.path, known)
    force = made.nodal_force[:, made.pulleys.index(f"{cable}/3")]
    again = identify_rho(rig.model, rig.path, known, f"{cable}/3", force)
    assert again.rho == pytest.approx(0.234, abs=1e-4), "exactly, from forces made with it"
    assert again.rms < 1e-3


def test_data_that_do_not_determine_rho_are_refused():
    rig = recording()
    known = KnownTension("upper/8", rig.said["tension/upper/8"], 0.02)
    force = rig.said["nodal_force/upper/3"]
    with pytest.raises(UsageError, match="the cable of upper/8 has no pulley lower/3; it has"):
        identify_rho(rig.model, rig.path, known, "lower/3", force)
    with pytest.raises(UsageError, match=r"must rise within \[0, 1\], got \(0.5, 0.2\)"):
        identify_rho(rig.model, rig.path, known, "upper/3", force, (0.5, 0.2))
    with pytest.raises(UsageError, match="has 3 readings for"):
        identify_rho(rig.model, rig.path, known, "upper/3", force[:3])
    still = rig.path.stamp_ns[:50]
    path = path_of(rig.model, still, np.zeros((50, 1)))
    resting = KnownTension("upper/8", rig.said["tension/upper/8"][:50], 0.02)
    with pytest.raises(UsageError, match="slide together in 0 samples; at least 20 are needed"):
        identify_rho(rig.model, path, resting, "upper/3", force[:50])
