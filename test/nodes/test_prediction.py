"""A node that predicts the slower topic publishes at once, and no stamp twice."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from support.estimators import JOINT, MOTOR, Bench, sample_at


@pytest.fixture
def bench(ros: None) -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def _published(node: Any, interval: int, late: int) -> list[list[int]]:
    """Stamps published after each of 400 motor readings 1 ms apart [ns].

    Args:
        node: the estimator.
        interval: of the joint's readings [ms].
        late: how much later than the motor's these arrive [ms].
    """
    published: list[list[int]] = []
    node.topics.publish = lambda output: published[-1].append(output.estimate.stamp_ns)
    for k in range(400):
        published.append([])
        sample = sample_at(k)
        node.motor(MOTOR.encode(sample.stamp_ns, position=sample.motor_angle))
        if k >= late and (k - late) % interval == 0:
            then = sample_at(k - late)
            node.joint(JOINT.encode(then.stamp_ns, position=then.joint_angle))
    return published


@pytest.mark.parametrize(("interval", "late"), [(2, 3), (1, 1), (10, 0), (50, 5)])
def test_no_stamp_is_published_twice_and_most_are_at_once(
    interval: int, late: int, bench: Bench
) -> None:
    node = bench.estimator(conditioning="predict")
    published = _published(node, interval, late)
    stamps = [stamp for one in published for stamp in one]
    assert stamps == sorted(set(stamps))
    at_once = [sample_at(k).stamp_ns in published[k] for k in range(400)]
    assert np.mean(at_once[100:]) == pytest.approx(min(20 - late, interval) / interval, abs=0.05)
    other = bench.estimator("-r", "__ns:=/other", conditioning="wait")
    _published(other, interval, late)
    assert np.array_equal(node.live.state.values, other.live.state.values)
