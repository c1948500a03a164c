"""The example controllers do on the rig's true tensions and angles what their pages say."""

import importlib
import sys

import pytest
from support.places import ROOT

TOOLS = ROOT / "tools"


@pytest.fixture(scope="module")
def measure():
    """The module that measures the controllers."""
    pytest.importorskip("rclpy")
    sys.path.insert(0, str(TOOLS))
    try:
        yield importlib.import_module("measure_controllers")
    finally:
        sys.path.remove(str(TOOLS))


def test_the_limiter_holds_every_true_tension_below_its_limit(measure):
    effect = measure.limiter(seconds=3.0, limit=60.0)
    assert effect.without > 100.0
    assert 45.0 < effect.having < 60.0, "below the limit, and not because the motor stands still"


def test_the_feedforward_reduces_the_tracking_error_by_a_factor_of_50(measure):
    effect = measure.feedforward(seconds=1.5)
    assert effect.without > 0.2
    assert effect.having < effect.without / 50.0


def test_the_cables_stay_taut_at_a_lower_mean_tension(measure):
    effect = measure.taut(seconds=3.6, share=0.4)
    assert effect.least > 1.0
    assert effect.having < 0.9 * effect.without


def test_a_push_is_detected_within_50_ms_and_motion_alone_is_not(measure):
    effect = measure.push(seconds=3.5, pushed_s=2.7)
    assert effect.without < 0.5
    assert 0.0 < effect.having < 0.05
