"""The messages of estimates, beside those that are encoded array by array."""

from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.estimation.ensemble import stddev_columns
from cdrj_ros.estimation.estimator import Estimate
from cdrj_ros.messages.cdr import CABLE_TENSIONS, JOINT_STATE, NODAL_FORCES, MessageError
from cdrj_ros.messages.templates import FORCES, Encoded, EstimateEncoder, Template
from cdrj_ros.model.prepared import load_model

STAMP_NS = 1_700_000_000_123_456_789


@pytest.fixture(scope="module", params=["prototype", "cdpr"])
def layout(request):
    return load_model(request.param).layout


def some_estimate(layout, seed, *, solved=True):
    """Random values, and every combination of flags."""
    random = np.random.default_rng(seed)
    values = random.normal(size=layout.size)
    values[layout.status] = random.integers(0, 256, len(layout.elements))
    return Estimate(STAMP_NS + seed, values, layout, solved)


def array_by_array(layout, frame_id, estimate, stddev):
    """The same messages, encoded by ``Template``."""
    more = () if stddev is None else ("stddev",)
    axes = layout.motors + layout.joints
    status = estimate.status.astype(np.uint8)
    parts = {} if stddev is None else {"stddev": np.asarray(stddev)}
    first, beyond = len(layout.elements), len(layout.elements) + len(layout.pulleys)
    of_forces = (
        "" if "upper" in layout.cables else frame_id
    )  # those of the prototype have no positions
    tensions = Template(CABLE_TENSIONS, layout.elements, ("tension", "status", *more), frame_id)
    forces = Template(NODAL_FORCES, layout.pulleys, (*(*FORCES, "status"), *more), of_forces)
    efforts = Template(JOINT_STATE, axes, ("effort",) if estimate.solved else (), frame_id)
    effort = {"effort": np.concatenate([estimate.motor_effort, estimate.joint_effort])}
    stamp, values = estimate.stamp_ns, estimate.values
    return Encoded(
        tensions.encode(
            stamp,
            tension=estimate.tension,
            status=status,
            **{k: v[:first] for k, v in parts.items()},
        ),
        forces.encode(
            stamp,
            status=layout.pulley_status(status),
            **{name: values[getattr(layout, name)] for name in FORCES},
            **{k: v[first:beyond] for k, v in parts.items()},
        ),
        efforts.encode(stamp, **(effort if estimate.solved else {})),
    )


@pytest.mark.parametrize("frame_id", ["base", "base_link"])
@pytest.mark.parametrize("uncertain", [False, True])
def test_all_bytes_are_those_of_messages_encoded_array_by_array(layout, frame_id, uncertain):
    encoder = EstimateEncoder(layout.in_frame(frame_id), uncertain)
    width = stddev_columns(layout).size
    for seed in range(20):
        estimate = some_estimate(layout, seed, solved=seed % 5 != 4)
        stddev = np.random.default_rng(100 + seed).random(width) if uncertain else None
        ours = encoder.encode(replace(estimate, stddev=stddev))
        assert ours == array_by_array(layout, frame_id, estimate, stddev)


@pytest.mark.parametrize("solved", [False, True])
def test_the_deviations_of_efforts_are_the_last_ones(layout, solved):
    stddev = np.arange(stddev_columns(layout).size) * 0.5
    estimate = some_estimate(layout, 1, solved=solved)
    payload = EstimateEncoder(layout, uncertain=True).efforts_stddev(
        replace(estimate, stddev=stddev)
    )
    axes, begin = layout.motors + layout.joints, len(layout.elements) + len(layout.pulleys)
    template = Template(JOINT_STATE, axes, ("effort",) if solved else (), "base")
    efforts = {"effort": stddev[begin:]} if solved else {}
    assert payload == template.encode(estimate.stamp_ns, **efforts)


def test_vectors_of_another_robot_are_refused(layout):
    certain, uncertain = EstimateEncoder(layout), EstimateEncoder(layout, uncertain=True)
    estimate, stddev = some_estimate(layout, 0), np.zeros(stddev_columns(layout).size)
    short = replace(estimate, values=estimate.values[:-1])
    for encoder, wrong in (
        (certain, replace(estimate, stddev=stddev)),
        (uncertain, estimate),
        (uncertain, replace(estimate, stddev=stddev[1:])),
        (certain, short),
    ):
        with pytest.raises(MessageError, match="the messages take"):
            encoder.encode(wrong)


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 1_000_000_000])
def test_stamps_that_no_header_can_hold_are_refused(layout, stamp_ns):
    estimate = replace(some_estimate(layout, 0), stamp_ns=stamp_ns)
    with pytest.raises(MessageError, match=f"stamp {stamp_ns} ns does not fit"):
        EstimateEncoder(layout).encode(estimate)
