"""Validation of a recording in pieces."""

import tracemalloc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from support.compared import compare
from support.motor_alone import without_encoder
from support.places import ROBOT, SAMPLE

from cdrj_ros.evaluation import estimating
from cdrj_ros.evaluation.channels import FrictionSums, estimate_channels
from cdrj_ros.evaluation.estimating import OUTPUTS, estimate, log_times, pieces_of, write_estimates
from cdrj_ros.evaluation.inputs import condition_recording, read_encoderless, read_inputs
from cdrj_ros.evaluation.validation import MAX_GAP_NS, BagTask, Validation, compare_bag
from cdrj_ros.foundation.errors import BagError
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics, read_recording

BAG = str(SAMPLE)


def test_a_recording_in_pieces_compares_as_all_its_estimates_and_takes_less_memory():
    model = load_model(ROBOT)
    recording = read_inputs(BAG, Topics(), model)
    conditioned = condition_recording(model, recording)
    whole = estimate(model, conditioned)
    references = {n: (s.stamp_ns, s.value) for n, s in recording.references.items()}
    named = estimate_channels(model.layout, whole.values)
    expected = compare(whole.stamp_ns, named, references, max_gap_ns=MAX_GAP_NS)
    (segment,) = conditioned.segments
    pieces = list(pieces_of(model, segment))
    assert len(pieces) > 3
    assert np.concatenate([piece.values for piece in pieces]).tobytes() == whole.values.tobytes()
    pieces.clear()
    tracemalloc.start()
    validation = Validation(model, BAG, recording, conditioned)
    for _ in validation.compare(pieces_of(model, segment)):
        pass
    got = validation.result({})
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.5 * whole.values.nbytes
    for one, other in zip(expected, got.channels, strict=True):
        assert one.name == other.name
        assert one.estimate.tobytes() == other.estimate.tobytes()


def test_a_bag_of_estimates_is_written_piece_by_piece(tmp_path, monkeypatch):
    """A piece is forgotten once it has been written."""
    monkeypatch.setattr(estimating, "AT_ONCE", 512)
    model = load_model(ROBOT)
    model = replace(model, layout=replace(model.layout, base_link="arm", force_frame="arm"))
    read = read_inputs(BAG, Topics(), model)
    motors, joints = (
        {name: one.part(slice(6000)) for name, one in of.items()}
        for of in (read.motors, read.joints)
    )
    recording = replace(read, motors=motors, joints=joints)
    conditioned = condition_recording(model, recording)
    stamps = conditioned.segments[0].stamp_ns
    alive = []
    most = 0

    def watched():
        nonlocal most
        validation = Validation(model, BAG, recording, conditioned)
        for piece in validation.compare(pieces_of(model, conditioned.segments[0])):
            alive.append(weakref.ref(piece))
            most = max(most, sum(one() is not None for one in alive))
            yield piece

    out = tmp_path / "out"
    write_estimates(str(out), BAG, log_times(recording, conditioned), watched())
    assert len(alive) > 10
    assert most <= 2
    found = read_recording(out, Topics(references=OUTPUTS), force_vectors=True)
    assert found.force_frame == "arm"
    assert all(np.array_equal(one.stamp_ns, stamps) for one in found.references.values())


def test_what_was_not_compared_is_counted_and_named():
    model = load_model(ROBOT)
    read = read_inputs(BAG, Topics(), model)
    conditioned = condition_recording(model, read)
    tension = read.references["tension/upper/8"]
    late = replace(tension, stamp_ns=tension.stamp_ns + 10**12)
    references = {"tension/upper/8": tension, "tension/third/1": tension, "effort/elbow": late}
    recording = replace(read, references=references, malformed={"/cdrj/motor_states": 4})
    validation = Validation(model, BAG, recording, conditioned)
    for _ in validation.compare(pieces_of(model, conditioned.segments[0])):
        pass
    found = validation.result({}, ("A remark.",))
    assert [channel.name for channel in found.channels] == ["tension/upper/8", "effort/elbow"]
    assert found.counters["malformed"] == 4
    assert found.counters["outside_estimates"] >= late.stamp_ns.size
    assert found.notes[-3:] == (
        "A remark.",
        "Recorded but not estimated, so not compared: tension/third/1.",
        "No reference sample has an estimate beside it: effort/elbow.",
    )


def test_efforts_are_inputs_and_the_recorded_angle_is_a_reference():
    model = without_encoder("prototype", "elbow")
    compared = compare_bag(BagTask(BAG, Topics(), window=(1.0, 20.0)), model=model)
    channels = {channel.name: channel for channel in compared.channels}
    assert "effort/winch" not in channels
    assert "effort/winch is an input here, and not compared." in compared.notes
    angle = channels["angle/elbow"]
    assert angle.unit == "rad"
    assert np.sqrt(np.mean((angle.estimate - angle.reference) ** 2)) < 5e-3
    assert np.ptp(angle.reference) > 0.5


def test_a_bag_without_efforts_is_refused():
    robot = without_encoder("prototype", "elbow").robot
    with pytest.raises(BagError, match="no efforts of winch, from which elbow"):
        read_encoderless(BAG, Topics(references=()), robot)


def test_shares_are_of_the_larger_tension():
    layout = load_model(ROBOT).layout
    n, elements = 200, len(layout.elements)
    tension = np.full((n, elements), 10.0)
    tension[:, layout.elements.index("upper/4")] = 8.0
    tension[:100, layout.elements.index("lower/1")] = 0.0
    tension[:100, layout.elements.index("lower/2")] = 0.0
    place = {name: k for k, name in enumerate(layout.elements)}
    after = [place[name] for name in layout.pulleys]
    friction = tension[:, after] - tension[:, [k - 1 for k in after]]
    values = np.zeros((n, layout.size))
    values[:, layout.tension], values[:, layout.friction] = tension, friction
    sums = FrictionSums(layout)
    for part in (slice(0, 70), slice(70, n)):
        sums.add(values[part])
    found = {one.name: one for one in sums.result()}
    assert list(found) == list(layout.pulleys)
    for name in ("upper/4", "upper/5"):
        assert found[name].mean == pytest.approx(2.0)
        assert found[name].mean_share == pytest.approx(0.2)
    assert found["upper/3"].largest_share == 0.0
    # samples of a slack cable do not count in the mean
    assert found["lower/2"].mean_share == 0.0
    # half of the time one side is slack, with share 1, and then the share is 0
    assert found["lower/3"].mean_share == pytest.approx(0.5)
