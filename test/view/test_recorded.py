"""A bag is shown with the estimates that the validation computes."""

import numpy as np
from support.places import SAMPLE

from cdrj_ros.evaluation.estimating import estimate
from cdrj_ros.evaluation.inputs import condition_recording, read_inputs
from cdrj_ros.foundation.arrays import Series
from cdrj_ros.model.prepared import load_model
from cdrj_ros.recordings.recording import Topics
from cdrj_ros.view import recorded


def test_a_film_shows_every_nth_estimate_of_the_validation_and_the_references(monkeypatch):
    model = load_model("prototype")
    recording = read_inputs(str(SAMPLE), Topics(), model)
    conditioned = condition_recording(model, recording)
    monkeypatch.setattr(recorded, "MOST", 1000)
    shares = []
    film = recorded.recorded_estimates(model, recording, conditioned, shares.append)
    whole = estimate(model, conditioned)
    every = 1 + len(whole.stamp_ns) // 1000
    assert every > 1
    np.testing.assert_array_equal(film.stamp_ns, whole.stamp_ns[::every])
    np.testing.assert_array_equal(film.tension, whole.values[::every, model.layout.tension])
    assert shares[-1] == 1.0
    reference = recording.references["tension/upper/1"]
    found = film.reference[:, model.layout.elements.index("upper/1")]
    assert np.isfinite(found).mean() > 0.9
    assert np.nanmin(found) >= reference.value.min()
    assert np.nanmax(found) <= reference.value.max()
    last = film.at(1e9)
    assert last.stamp_ns == film.stamp_ns[-1]
    assert film.at(-1.0).stamp_ns == film.stamp_ns[0]
    np.testing.assert_array_equal(last.tension, film.tension[-1])


def test_a_reference_is_unknown_outside_and_in_gaps():
    second = 1_000_000_000
    times = np.array([0, 50_000_000, 2 * second])
    series = Series(times, times, np.array([1.0, 2.0, 3.0]))
    wanted = np.array([-1, 25_000_000, second, 2 * second, 3 * second])
    found = recorded.at_stamps(series, wanted)
    np.testing.assert_allclose(found, [np.nan, 1.5, np.nan, 3.0, np.nan])
