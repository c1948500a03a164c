"""The finger of the URDF in the rig."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdrj_ros.commands.simulate import main as simulate
from cdrj_ros.evaluation.validation import validate_bag
from cdrj_ros.model.loading import load_model
from cdrj_ros.recordings import Topics


def test_the_rigs_force_on_a_sheath_is_that_of_both_pulls(tmp_path: Path) -> None:
    """A sheath turns the cable by more than the angle between its ends."""
    bag = str(tmp_path / "bag")
    assert simulate([bag, "--robot", "finger3d", "--duration", "2", "--cells", "2"]) == 0
    compared = validate_bag(load_model("finger3d"), bag, Topics())
    forces = {one.name: one for one in compared.channels if one.name.startswith("nodal_force")}
    assert {"nodal_force/flexor/2", "nodal_force/left/2"} < set(forces)
    for one in forces.values():
        assert np.abs(one.estimate - one.reference).mean() < 0.2, one.name
