"""Validation of a recording in pieces."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np

from cdrj_ros.bag import Topics
from cdrj_ros.estimation.estimator import Estimates
from cdrj_ros.judgement.channels import estimate_channels
from cdrj_ros.judgement.comparison import compare
from cdrj_ros.judgement.estimating import estimate
from cdrj_ros.judgement.validation import (
    MAX_GAP_NS,
    condition_recording,
    read_inputs,
    validate_recording,
)
from cdrj_ros.model.loading import load_model

ROOT = Path(__file__).parents[2]
BAG = str(ROOT / "bags" / "prototype_preload_36_26")
ROBOT = str(ROOT / "config" / "robots" / "prototype.yaml")


def test_a_recording_in_pieces_compares_as_all_its_estimates_and_takes_less_memory() -> None:
    model = load_model(ROBOT)
    recording = read_inputs(BAG, Topics(), model)
    conditioned = condition_recording(model, recording)
    whole = estimate(model, conditioned)
    references = {n: (s.stamp_ns, s.value) for n, s in recording.references.items()}
    named = estimate_channels(model.layout, whole.values)
    expected = compare(whole.stamp_ns, named, references, max_gap_ns=MAX_GAP_NS)
    pieces: list[Estimates] = []
    validate_recording(model, BAG, recording, conditioned, keep=pieces.append)
    assert len(pieces) > 3
    assert np.concatenate([piece.values for piece in pieces]).tobytes() == whole.values.tobytes()
    pieces.clear()
    tracemalloc.start()
    got = validate_recording(model, BAG, recording, conditioned)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.5 * whole.values.nbytes
    for one, other in zip(expected, got.channels, strict=True):
        assert one.name == other.name
        assert one.estimate.tobytes() == other.estimate.tobytes()
