"""Estimates are interpolated at the reference's stamps; the reference is unchanged."""

import numpy as np
import pytest
from support.compared import compare, series_of

from cdrj_ros.evaluation.channels import QUANTITIES, Angle, unit_of
from cdrj_ros.evaluation.comparison import DROP_CAUSES, Comparing

EPOCH_NS = 1_722_000_000_123_456_789
NAME = "tension/upper/8"


def one(stamps, values, reference, max_gap_ns=1000):
    (channel,) = compare(stamps, {NAME: values}, {NAME: reference}, max_gap_ns=max_gap_ns)
    return channel


def test_coinciding_stamps_leave_every_bit_of_the_estimate():
    random = np.random.default_rng(1)
    stamps = EPOCH_NS + np.arange(1000, dtype=np.int64) * 333_333
    values = random.normal(size=1000) * 10.0 ** random.integers(-300, 300, 1000)
    chosen = np.sort(random.choice(1000, 400, replace=False))
    channel = one(stamps, values, (stamps[chosen], np.zeros(400)), max_gap_ns=10**9)
    assert channel.estimate.tobytes() == values[chosen].tobytes()
    # also with other reference samples in between
    mixed = np.sort(np.concatenate([stamps[chosen], stamps[:-1] + 5]))
    channel = one(stamps, values, (mixed, np.zeros(len(mixed))), max_gap_ns=10**9)
    at = np.searchsorted(channel.stamp_ns, stamps[chosen])
    assert channel.estimate[at].tobytes() == values[chosen].tobytes()


def test_nothing_is_compared_outside_the_estimates_or_across_a_gap():
    channel = one([0, 10, 100, 110], [1.0] * 4, ([-1, 0, 5, 10, 50, 100, 105, 111], [2.0] * 8), 10)
    assert channel.stamp_ns.tolist() == [0, 5, 10, 100, 105]
    assert channel.dropped["outside_estimates"] == 2
    assert channel.dropped["between_distant_estimates"] == 1


def test_references_are_sorted_and_of_equal_stamps_the_first_counts():
    channel = one([0, 10], [0.0, 10.0], ([7, 3, 7, 0], [70.0, 30.0, 71.0, 0.0]))
    assert channel.stamp_ns.tolist() == [0, 3, 7]
    assert channel.reference.tolist() == [0.0, 30.0, 70.0]
    assert channel.dropped["reference_repeated"] == 1


def test_values_that_are_not_finite_are_left_out_and_counted():
    channel = one(
        [0, 10, 20, 30],
        [0.0, 1.0, np.nan, np.inf],
        ([0, 0, 5, 10, 15, 20, 30, 8], [np.nan, 4.0, 1.0, 2.0, 3.0, 4.0, 5.0, np.inf]),
    )
    assert channel.stamp_ns.tolist() == [0, 5, 10]
    assert channel.reference.tolist() == [4.0, 1.0, 2.0]
    assert channel.estimate.tolist() == [0.0, 0.5, 1.0]
    assert channel.dropped["reference_not_finite"] == 2
    assert channel.dropped["estimate_not_finite"] == 3
    assert set(channel.dropped) == set(DROP_CAUSES)
    nothing = one([], [], ([0, 1], [1.0, 2.0]))
    assert (len(nothing.stamp_ns), nothing.dropped["outside_estimates"]) == (0, 2)


def test_every_reference_sample_is_compared_or_counted():
    random = np.random.default_rng(3)
    values = random.normal(size=300)
    values[::17] = np.nan
    stamps = np.sort(random.choice(20_000, 100, replace=False))
    own = random.normal(size=100)
    own[::9] = np.nan
    channel = one(stamps, own, (random.integers(0, 20_000, 300), values), 400)
    assert len(channel.stamp_ns) + sum(channel.dropped.values()) == 300
    assert np.all(np.diff(channel.stamp_ns) > 0)
    assert np.isfinite(channel.estimate).all()
    assert np.isfinite(channel.reference).all()


def test_the_angle_is_added_where_it_is_known():
    stamps = np.array([0, 10, 20, 30, 100])
    rolling = Angle("rolling", np.array([10, 20, 90]), np.array([1.0, 2.0, 9.0]))
    reference = {NAME: (stamps, np.zeros(5)), "effort/spindle": (stamps, np.zeros(5))}
    estimates = {name: np.zeros(5) for name in reference}
    both = compare(stamps, estimates, reference, max_gap_ns=50, angle=rolling)
    for channel in both:
        assert channel.angle_name == "rolling"
        np.testing.assert_array_equal(channel.angle, [np.nan, 1.0, 2.0, np.nan, np.nan])
    tension, effort = compare(stamps, estimates, reference, max_gap_ns=50, angle={NAME: rolling})
    assert tension.angle_name == "rolling"
    assert effort.angle_name == ""
    assert np.isnan(effort.angle).all()


@pytest.mark.parametrize("sizes", [[1] * 100, [37, 0, 1, 50, 12], [99, 1]])
def test_the_pieces_in_which_estimates_come_change_no_bit(sizes):
    random = np.random.default_rng(7)
    stamps = EPOCH_NS + np.cumsum(random.integers(1, 300, 100))
    reference = np.sort(random.integers(int(stamps[0]) - 500, int(stamps[-1]) + 500, 400))
    references = {
        NAME: (reference, random.normal(size=400)),
        "effort/winch": (stamps[::3], random.normal(size=34)),
    }
    values = {name: random.normal(size=100) for name in references}
    values[NAME][[5, 36, 37, 70]] = np.nan
    deviations = {NAME: random.uniform(0.1, 1.0, 100)}
    deviations[NAME][[4, 36, 80]] = -1.0
    whole = compare(stamps, values, references, max_gap_ns=250, stddev=deviations)
    series = {name: series_of(*given) for name, given in references.items()}
    comparing = Comparing(list(values), stamps, series, 250)
    begin = 0
    for size in sizes:
        part = slice(begin, begin + size)
        comparing.add(
            {name: column[part] for name, column in values.items()},
            {name: column[part] for name, column in deviations.items()},
            size,
        )
        begin += size
    for one, other in zip(whole, comparing.channels(None), strict=True):
        assert len(one.stamp_ns) > 20
        for column in ("stamp_ns", "estimate", "reference"):
            assert getattr(one, column).tobytes() == getattr(other, column).tobytes()
        assert one.dropped == other.dropped
        np.testing.assert_array_equal(one.stddev, other.stddev)


def test_names_need_a_known_prefix():
    assert {unit_of(f"{prefix}/a/1") for prefix in QUANTITIES} == {"N", "N·m", "rad"}
    for name in ("tension", "tension/", "torque/a", ""):
        with pytest.raises(ValueError, match="channel name must be one of tension/"):
            unit_of(name)
