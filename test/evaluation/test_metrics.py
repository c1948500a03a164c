"""The figures of one channel, of many, and of several recordings."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from cdrj_ros.evaluation.channels import BagComparison, Channel
from cdrj_ros.evaluation.metrics import (
    MINIMUM_SHARE,
    NO_SAMPLES,
    ChannelError,
    channel_error,
    errors_of,
    mean_over_channels,
    pooled_errors,
)
from cdrj_ros.foundation.interruption import BLAS_THREADS


def channel(name, estimate, reference):
    n = len(reference)
    return Channel(
        name, "N", np.arange(n, dtype=np.int64), estimate, reference, np.full(n, np.nan), ""
    )


def test_figures_agree_with_those_computed_by_hand():
    # errors 1, -1, 2, 0; squares 6; reference mean 5, deviations -3 -1 0 4 of square sum 26
    error = channel_error([3.0, 3.0, 7.0, 9.0], [2.0, 4.0, 5.0, 9.0])
    assert error.n == 4
    assert error.mean_abs_error == pytest.approx(1.0)
    assert error.mean_relative_error == pytest.approx((1 / 2 + 1 / 4 + 2 / 5 + 0) / 4)
    assert error.rmse == pytest.approx(np.sqrt(6 / 4))
    assert error.max_abs_error == 2.0
    assert error.r2 == pytest.approx(1 - 6 / 26)


def test_digits_do_not_depend_on_the_number_of_processors():
    code = (
        "import numpy as np; from cdrj_ros.evaluation.metrics import channel_error; "
        "random = np.random.default_rng(7); "
        "print(*(channel_error(*random.normal(size=(2, 20_001))) for _ in range(10)))"
    )

    def figures(processors):
        variables = os.environ | {BLAS_THREADS: processors}
        return subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, env=variables
        ).stdout

    assert figures("1") == figures("2") != b""


def test_relative_error_leaves_out_references_close_to_zero():
    reference = np.array([100.0, 100.0 * MINIMUM_SHARE, 0.9 * 100.0 * MINIMUM_SHARE, 0.0])
    error = channel_error(reference + np.array([1.0, 0.5, 50.0, 50.0]), reference)
    assert error.mean_relative_error == pytest.approx((0.01 + 0.5) / 2)


def test_undefined_figures_are_none():
    assert channel_error([], []) == NO_SAMPLES
    assert channel_error([1.0], [2.0]).r2 is None
    assert channel_error([1.0, 2.0], [0.0, 0.0]).mean_relative_error is None
    # In floating point the mean of these equal numbers differs from them.
    assert channel_error(np.zeros(10), np.full(10, 0.1)).r2 is None


def test_pooled_figures_are_those_of_the_joined_samples():
    random = np.random.default_rng(6)
    parts = [(random.normal(size=n), random.normal(loc=n, size=n)) for n in (10, 300)]
    bags = [
        BagComparison(f"bag {i}", 1.0, (channel("tension/upper/8", *part),))
        for i, part in enumerate(parts)
    ]
    whole = (np.concatenate(column) for column in zip(*parts, strict=True))
    joined = channel_error(*whole, unit="N")
    assert pooled_errors(bags) == {"tension/upper/8": joined}
    single = [own["tension/upper/8"] for own in errors_of(bags).of_bags]
    assert joined.mean_abs_error != pytest.approx(np.mean([e.mean_abs_error or 0 for e in single]))


def test_pooling_keeps_what_one_recording_has_but_no_figure_that_another_lacks():
    plain = channel("tension/a/1", np.ones(3), np.ones(3))
    told = replace(plain, stddev=np.ones(3))
    other = channel("effort/spindle", np.ones(3), np.ones(3))
    bags = [BagComparison("a", 1.0, (plain,)), BagComparison("b", 1.0, (told, other))]
    pooled = pooled_errors(bags)
    assert list(pooled) == ["tension/a/1", "effort/spindle"]
    assert pooled["tension/a/1"].coverage is None
    assert pooled_errors(bags[1:])["tension/a/1"].coverage == 1.0


def test_channels_have_equal_weight_in_the_mean_and_the_maximum_is_kept():
    overall = mean_over_channels(
        [
            ChannelError(1000, 1.0, 0.1, 2.0, 5.0, 0.9),
            ChannelError(10, 3.0, None, 4.0, 4.0, 0.7),
            NO_SAMPLES,
        ]
    )
    assert overall == ChannelError(
        1010, pytest.approx(2.0), pytest.approx(0.1), pytest.approx(3.0), 5.0, pytest.approx(0.8)
    )
    assert mean_over_channels([]) == NO_SAMPLES


def test_coverage_of_a_normal_estimate_with_correct_deviations_is_that_of_two_sigmas():
    random = np.random.default_rng(8)
    stddev = random.uniform(0.1, 3.0, 200_000)
    reference = random.normal(20.0, 5.0, 200_000)
    estimate = reference + stddev * random.normal(size=200_000)
    coverage = channel_error(estimate, reference, stddev=stddev).coverage
    assert coverage == pytest.approx(0.9545, abs=0.002)
    too_small = channel_error(estimate, reference, stddev=0.5 * stddev).coverage
    assert too_small == pytest.approx(0.6827, abs=0.004)


def test_coverage_counts_only_samples_whose_deviation_is_known():
    stddev = np.array([1.0, np.nan, 0.1, np.nan])
    assert channel_error([1.0, 9.0, 1.0, 9.0], np.zeros(4), stddev=stddev).coverage == 0.5
    assert channel_error([1.0], [0.0], stddev=[np.nan]).coverage is None
    assert channel_error([1.0], [1.0], stddev=[0.0]).coverage == 1.0
