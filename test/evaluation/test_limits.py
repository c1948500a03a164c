"""Parsing of limits files, and comparison with limits."""

import numpy as np
import pytest
from support.refusal import refusal

from cdrj_ros.evaluation.channels import BagComparison, Channel
from cdrj_ros.evaluation.limits import check_limits, load_limits, parse_limits
from cdrj_ros.evaluation.metrics import errors_of


def bag(path="a", error=0.1, stddev=None):
    n = 100
    reference = np.linspace(10.0, 20.0, n)
    deviation = None if stddev is None else np.full(n, stddev)
    channels = tuple(
        Channel(
            name, "N", np.arange(n, dtype=np.int64), reference + e, reference, np.full(n, np.nan),
            "", stddev=deviation,
        )
        for name, e in (("tension/upper/1", error), ("tension/upper/2", 2 * error))
    )  # fmt: skip
    return BagComparison(path, 1.0, channels)


def judged(text, *bags):
    limit_check = check_limits(parse_limits(text, "limits.yaml"), errors_of(bags or [bag()]))
    return [(o.where, o.channel, o.figure, o.value, o.bound) for o in limit_check.outside]


def test_figures_within_their_limits_are_only_counted():
    limit_check = check_limits(
        parse_limits("channels: {tension/*: {rmse: {max: 0.5}, r2: {min: 0.5, max: 1}}}", "f"),
        errors_of([bag()]),
    )
    assert limit_check.checked == 6
    assert limit_check.outside == ()


def test_a_figure_outside_is_named_with_its_bound_and_excess():
    limits = parse_limits("channels: {tension/upper/?: {rmse: {max: 0.15}}}", "f")
    (outside,) = check_limits(limits, errors_of([bag()])).outside
    assert (outside.channel, outside.figure, outside.least) == ("tension/upper/2", "rmse", False)
    assert outside.by == pytest.approx(0.05)


def test_a_quantity_alone_stands_for_the_mean_over_its_channels():
    assert judged("channels: {tension: {rmse: {max: 0.151}}}") == []
    ((_, channel, _, value, _),) = judged("channels: {tension: {rmse: {max: 0.149}}}")
    assert channel == "tension"
    assert value == pytest.approx(0.15)


def test_a_pattern_that_no_channel_matches_is_outside():
    text = "channels: {tension/lower/1: {n: {min: 1}}}"
    assert judged(text) == [("a", "tension/lower/1", "n", None, 1)]
    assert check_limits(parse_limits(text, "f"), errors_of([bag()])).checked == 1


def test_a_figure_that_is_not_known_is_outside():
    text = "channels: {tension/upper/1: {coverage: {min: 0.9}}}"
    assert judged(text) == [("a", "tension/upper/1", "coverage", None, 0.9)]
    assert judged(text, bag(stddev=0.06)) == []
    assert judged(text, bag(stddev=0.04))[0][3] == 0.0


def test_recordings_are_judged_together_and_on_request_each_by_itself():
    bags = bag("good", 0.01), bag("bad", 0.5)
    text = "channels: {tension/upper/1: {mean_abs_error: {max: 0.3}}}"
    assert judged(text, *bags) == []
    ((where, *_),) = judged(f"judge: each\n{text}", *bags)
    assert where == "bad"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("channels: {tension/*: {rsme: {max: 1}}}", ["channels.tension/*.rsme", "mean rmse"]),
        ("chanels: {}", ["chanels is not a known key", "mean channels"]),
        ("channels: {tension/*: {rmse: 1}}", ["channels.tension/*.rmse must be of type object"]),
        ("channels: {tension/*: {rmse: {max: .nan}}}", ["rmse.max must be a finite"]),
        ("channels: {tension/*: {rmse: {min: 2, max: 1}}}", ["rmse.min must be at most max"]),
        ("channels: {tension/*: {rmse: {}}}", ["rmse must be: a mapping with min, max or both"]),
        ("channels: {tention/*: {rmse: {max: 1}}}", ["channels.tention/* names no channel"]),
        ("channels: {}", ["names no limit"]),
        ("judge: some\nchannels: {}", ["judge must be one of all, each"]),
        ("[[a]]: 1", ["not YAML"]),
        ('channels: {"tension/\\e[31m": 1}', ["tension/\\x1b[31m must be of type object"]),
        ("", ["must hold a mapping with channels and judge"]),
    ],
)
def test_invalid_limits_are_refused_with_the_path_of_the_key(text, words, tmp_path):
    path = tmp_path / "limits.yaml"
    path.write_text(text)
    message = refusal(load_limits, path)
    for word in (*words, str(path)):
        assert word in message
