"""Recomputation of all bold numbers of examples/paper/slips.md for the prototype."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import exp, pi, radians
from pathlib import Path

import numpy as np
import pytest

from cdrj_ros.model.friction import (
    Stribeck,
    bearing_transmission,
    blended_loss,
    capstan_transmission,
    sliding_loss,
    sliding_transmission,
    stribeck_share,
)
from cdrj_ros.model.joint import RollingLoad, RollingStrands
from cdrj_ros.model.prepared import prepare, shape_at
from cdrj_ros.robot.reader import load_robot

ROOT = Path(__file__).parents[2]
DOCUMENT = ROOT / "examples" / "paper" / "slips.md"
ROBOT = load_robot(ROOT / "config" / "robots" / "prototype.yaml")
UPPER = ROBOT.cables[0]
AMPLITUDE = radians(38.0)
STROKE = RollingStrands().length_change(np.array(AMPLITUDE)).item()
"""Change of length of both strands of a cable from the middle pose to 38 degrees [m]."""
STRANDS_PER_SPEED = 2 * 0.06
"""Slip speed at pulleys 2 to 5 per joint speed in the middle pose [m/rad]."""
WRAPS = shape_at(prepare(ROBOT), np.zeros(1)).wrap[:7]


def motion(frequency: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, speed and acceleration over one period of a sine of 38 degrees."""
    omega = 2.0 * pi * frequency
    phase = np.linspace(0.0, 2.0 * pi, 2001)
    angle = AMPLITUDE * np.sin(phase)
    return angle, AMPLITUDE * omega * np.cos(phase), -(omega**2) * angle


def ratio(k: int) -> float:
    """1 / alpha of pulley k + 2."""
    pulley = UPPER.pulleys[k]
    return pulley.friction.bearing_friction * pulley.bearing_diameter / pulley.radius


def losses(k: int, rho: float = 0.2, form: Stribeck = Stribeck.printed) -> tuple[float, float]:
    friction = UPPER.pulleys[k].friction
    return blended_loss(rho, friction.mu_c, friction.mu_s, WRAPS[k], ratio(k), form)


def transmission(share: float, rho: float = 0.2, form: Stribeck = Stribeck.printed) -> float:
    """Transmission of all pulleys together with this share of static friction."""
    pairs = (losses(k, rho, form) for k in range(7))
    return float(np.prod([1.0 - kinetic - share * static for kinetic, static in pairs]))


def dynamics() -> list[float]:
    worst = []
    for frequency in (0.1, 1.0):
        angle, speed, acceleration = motion(frequency)
        right, printed = (
            RollingLoad(form=form).torque(angle, speed, acceleration)
            for form in ("corrected", "published")
        )
        gap = RollingStrands().tension_difference(angle, printed - right)
        worst.append(float(np.abs(gap).max()))
    return worst


def lever() -> list[float]:
    torque = RollingLoad().weight_torque(np.array(0.0))
    right, printed = (
        RollingStrands(form=form).tension_difference(np.array(0.0), torque).item()
        for form in ("corrected", "published")
    )
    return [float(torque), right, printed]


def linear_element() -> list[float]:
    # 74 mm of cable pass pulley 3 into element 3; the tensions differ by the pulley's friction
    kinetic, static = losses(1)
    difference = (kinetic + static) * UPPER.preload
    length = shape_at(prepare(ROBOT), np.zeros(1)).length[2]
    return [STROKE * 1e3, difference, STROKE * difference / length]


def arcs() -> list[float]:
    pose = [shape_at(prepare(ROBOT), np.array([q])) for q in (-radians(40.0), radians(40.0))]
    arc = UPPER.pulleys[4].radius * (pose[1].wrap[4] - pose[0].wrap[4])
    whole = shape_at(prepare(ROBOT), np.zeros(1)).length[:8].sum()
    return [arc * 1e3, UPPER.axial_stiffness * arc / whole]


def equality() -> list[float]:
    together = transmission(1.0)
    return [together * UPPER.preload, UPPER.preload / together]


def sign() -> list[float]:
    kinetic, _ = sliding_loss(0.15, 0.2, pi, Stribeck.printed)
    return [(1.0 - exp(0.15 * pi)) * UPPER.preload, kinetic * UPPER.preload]


def static_form() -> list[float]:
    printed, capstan = (
        sum(sliding_loss(0.15, 0.2, pi, form)) for form in (Stribeck.printed, Stribeck.capstan)
    )
    difference = (printed - capstan) * UPPER.preload
    kinetic = 1.0 - capstan_transmission(0.1, pi)
    return [difference, 0.2 * difference, 1.0 - kinetic * 0.4 / 0.1]


def lowest() -> list[float]:
    etas = [
        sliding_transmission(0.0, 0.15, 0.2, 0.05, beta, Stribeck.printed) for beta in table_wraps()
    ]
    return [min(etas)]


def table_wraps() -> list[float]:
    """Wrap angles of Table I, with the largest one of pulley 6 [rad]."""
    return [radians(degrees) for degrees in (40.9, 105.4, 32.1, 57.7, 78.5, 180.0, 90.0)]


def bearing() -> list[float]:
    whole, half = (
        1.0 - np.prod([bearing_transmission(b, s * ratio(k)) for k, b in enumerate(table_wraps())])
        for s in (1.0, 0.5)
    )
    return [float(half) * UPPER.preload, float(whole) * UPPER.preload]


def order() -> list[float]:
    # with (43) as printed, the loss of the bearing alone would exceed that of sliding
    sliding = sum(sliding_loss(0.15, 0.2, pi, Stribeck.printed)) * UPPER.preload
    return [sliding, (1.0 - bearing_transmission(pi, ratio(5))) * UPPER.preload]


def viscous() -> list[float]:
    _, speed, _ = motion(0.1)
    fastest = STRANDS_PER_SPEED * float(np.abs(speed).max())
    return [fastest * 1e3, 500.0 * fastest]


def stribeck() -> list[float]:
    _, speed, _ = motion(0.1)
    fast = STRANDS_PER_SPEED * float(np.abs(speed).max()) / 2.0
    tensions = [UPPER.preload / transmission(stribeck_share(fast, v_s)) for v_s in (5e-2, 1e-4)]
    return [tensions[0] - tensions[1]]


EFFECTS: dict[str, Callable[[], list[float]]] = {
    "(7), (9)": dynamics,
    "(10)": lever,
    "(11)": linear_element,
    "(3), Table I": arcs,
    "(24)": equality,
    "(34)–(37)": sign,
    "(35)": static_form,
    "η above 0.8": lowest,
    "(39)": bearing,
    "(43)": order,
    "σ_2": viscous,
    "v_s": stribeck,
}


def sections() -> dict[str, str]:
    """Text of every slip, by the name at the beginning of its heading."""
    parts = re.split(r"^### ", DOCUMENT.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {part.split(":", 1)[0]: part for part in parts}


@pytest.mark.parametrize("name", EFFECTS)
def test_the_printed_effects_are_the_computed_ones(name: str) -> None:
    printed = re.findall(r"\*\*(−?[0-9.]+)\*\*", sections()[name])
    computed = EFFECTS[name]()
    assert len(printed) == len(computed), (printed, computed)
    for text, value in zip(printed, computed, strict=True):
        decimals = len(text.partition(".")[2])
        shown = f"{value:.{decimals}f}".replace("-", "−")
        assert shown == text, (printed, computed)


def test_every_slip_of_the_table_has_its_section() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    rows = [line.split("|")[1].strip() for line in text.splitlines() if line.startswith("| ")]
    named = [row for row in rows if row != "where"]
    assert set(named) == set(sections())
    assert set(EFFECTS) <= set(named)


def test_the_robot_file_has_the_values_of_tables_one_and_two() -> None:
    # the prototype file holds Tables I and II; its middle pose has pulley 6 half-way
    expected = table_wraps()
    expected[4] = radians(0.5 * (0.6 + 78.5))
    np.testing.assert_allclose(WRAPS, expected, rtol=1e-9)
    assert UPPER.preload == 36.85
    assert {p.friction.rho for p in UPPER.pulleys} == {0.2}
