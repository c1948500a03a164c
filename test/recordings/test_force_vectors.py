"""Recorded nodal forces are vectors only where their components say so."""

import numpy as np
import pytest

from cdrj_ros.messages.templates import Template
from cdrj_ros.recordings.definitions import parse_definition
from cdrj_ros.recordings.recording import Topics, read_recording
from cdrj_ros.recordings.writer import BagWriter

COUNT = 50
STAMPS = 1_700_000_000_000_000_000 + 1_000_000 * np.arange(COUNT, dtype=np.int64)
NAMES = ["a/2", "a/3"]
FORCE = np.random.default_rng(3).normal(20.0, 5.0, (COUNT, len(NAMES), 3))
NORM = np.sqrt(np.sum(FORCE**2, axis=2))


def arrays(force=FORCE, magnitude=NORM):
    components = {f"force_{axis}": force[:, :, k] for k, axis in enumerate("xyz")}
    return {"magnitude": magnitude, **components}


def recorded(folder, given):
    with BagWriter(folder / "bag") as bag:
        for topic in (Topics().motors, Topics().joints):
            bag.write_joint_states(topic, STAMPS, ["m"], position=np.zeros((COUNT, 1)))
        bag.write_nodal_forces(Topics().references[1], STAMPS, NAMES, **given)
    return read_recording(folder / "bag", force_vectors=True)


def test_components_that_give_their_magnitude_come_back_bit_for_bit(tmp_path):
    read = recorded(tmp_path, arrays())
    assert list(read.references) == [
        "nodal_force/a/2", "nodal_force/a/3", "force_vector/a/2", "force_vector/a/3",
    ]  # fmt: skip
    for k, name in enumerate(NAMES):
        np.testing.assert_array_equal(read.references[f"force_vector/{name}"].value, FORCE[:, k])
        np.testing.assert_array_equal(read.references[f"nodal_force/{name}"].value, NORM[:, k])
    assert read.notes == ()


@pytest.mark.parametrize(
    "given",
    [
        {"magnitude": NORM},
        arrays(np.zeros_like(FORCE)),
        arrays(np.full_like(FORCE, np.nan)),
        arrays(np.zeros_like(FORCE), np.zeros_like(NORM)),
        {name: one for name, one in arrays().items() if name != "force_z"},
    ],
    ids=["empty", "zero", "not a number", "nothing but zero", "one empty"],
)
def test_a_reference_without_components_has_only_magnitudes(given, tmp_path):
    read = recorded(tmp_path, given)
    assert set(read.references) == {"nodal_force/a/2", "nodal_force/a/3"}
    assert read.notes == ()
    assert sum(read.malformed.values()) == 0


def test_noise_of_both_and_a_slack_cable_do_not_contradict(tmp_path):
    random = np.random.default_rng(5)
    slack = np.where(np.arange(COUNT)[:, None] < 10, 0.0, 1.0)
    force = slack[..., None] * FORCE
    noisy = force + random.normal(0.0, 0.02, force.shape)
    magnitude = np.abs(slack * NORM + random.normal(0.0, 0.02, NORM.shape))
    read = recorded(tmp_path, arrays(noisy, magnitude))
    np.testing.assert_array_equal(read.references["force_vector/a/2"].value, noisy[:, 0])
    assert read.notes == ()


def test_zero_beside_a_magnitude_is_left_out_and_named_and_zero_without_one_is_kept(tmp_path):
    force, norm = FORCE.copy(), NORM.copy()
    force[7, 0] = 0.0
    force[8, 0], norm[8, 0] = 0.0, 0.0
    read = recorded(tmp_path, arrays(force, norm))
    value = read.references["force_vector/a/2"].value
    assert np.flatnonzero(np.isnan(value).any(axis=1)).tolist() == [7]
    kept = np.delete(np.arange(COUNT), 7)
    np.testing.assert_array_equal(value[kept], force[kept, 0])
    np.testing.assert_array_equal(read.references["force_vector/a/3"].value, FORCE[:, 1])
    (note,) = read.notes
    assert note.startswith("force_vector/a/2: 1 forces with components of zero")


def test_components_that_do_not_give_the_magnitude_are_no_vector(tmp_path):
    force = FORCE.copy()
    force[:, 0, 0] = 0.0  # a sensor that lacks an axis
    read = recorded(tmp_path, arrays(force))
    assert "force_vector/a/2" not in read.references
    assert "nodal_force/a/2" in read.references
    assert "force_vector/a/3" in read.references
    (note,) = read.notes
    assert note.startswith("force_vector/a/2: the norm of the components differs")


@pytest.mark.parametrize("scalars", [(), ("force_x", "force_y", "force_z")])
def test_a_bag_whose_own_definition_has_no_arrays_of_components_is_read(make, scalars, tmp_path):
    kind, topics = "cdrj_msgs/msg/NodalForces", Topics()
    text = "std_msgs/Header header\nstring[] name\nfloat64[] magnitude\n"
    text += "".join(f"float64 {one}\n" for one in scalars)
    template = Template(parse_definition(kind, text), NAMES, ("magnitude",))
    stamps = STAMPS.tolist()
    forces = [(stamp, template.encode(stamp, magnitude=np.full(2, 2.0))) for stamp in stamps]
    angles = [(stamp, make.joint_state(stamp, ["m"], [0.0])) for stamp in stamps]
    of_angles = ("sensor_msgs/msg/JointState", "", angles)
    path = make.write_topics(
        tmp_path / "own.mcap",
        {topics.motors: of_angles, topics.joints: of_angles,
         topics.references[1]: (kind, text, forces)},
    )  # fmt: skip
    read = read_recording(path, force_vectors=True)
    assert set(read.references) == {"nodal_force/a/2", "nodal_force/a/3"}
    assert read.references["nodal_force/a/3"].value.tolist() == [2.0] * COUNT
