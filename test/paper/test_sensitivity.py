"""Figure 8: the transmissions decrease and increase as the source states, except where it errs."""

from __future__ import annotations

import numpy as np
import pytest

from examples.paper.sensitivity import SENSITIVITIES

PANELS = {(panel.transmission, panel.parameter): panel for panel in SENSITIVITIES}

DIRECTION = {
    ("eta_d", "mu_c"): -1,
    ("eta_d", "mu_s"): -1,
    ("eta_d", "wrap_deg"): -1,
    ("eta_d", "speed"): 1,
    ("eta_r", "f_d"): -1,
    ("eta_r", "bearing_mm"): -1,
    ("eta_r", "radius_mm"): 1,
    ("eta_r", "wrap_deg"): -1,
}


@pytest.mark.parametrize("key", DIRECTION, ids="-".join)
def test_transmission_is_monotone_in_every_parameter(key: tuple[str, str]) -> None:
    for value in PANELS[key].values:
        curve = PANELS[key].curve(value)
        assert np.all((curve > 0.0) & (curve <= 1.0))
        assert np.all(DIRECTION[key] * np.diff(curve) > 0.0)


@pytest.mark.parametrize("key", DIRECTION, ids="-".join)
def test_more_wrap_or_friction_in_the_family_transmits_less(key: tuple[str, str]) -> None:
    lowest = [PANELS[key].curve(value)[30] for value in sorted(PANELS[key].values)]
    assert lowest == sorted(lowest, reverse=True)


def test_eta_d_falls_below_the_sources_limit_of_0_8_wherever_the_wrap_is_large() -> None:
    panel = PANELS["eta_d", "wrap_deg"]
    for value in panel.values:
        curve = panel.curve(value)
        assert curve[panel.grid <= 60.0].min() > 0.8
        assert curve[panel.grid >= 100.0].max() < 0.8
