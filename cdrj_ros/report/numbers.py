"""Formatting of numbers: few digits, typographic minus signs, milli-units for small values."""

from __future__ import annotations

import math
from typing import Final

ABSENT: Final = "\N{EN DASH}"
"""Text in place of an unknown figure."""

_MINUS: Final = "\N{MINUS SIGN}"


def format_number(value: float | None, decimals: int) -> str:
    """A figure with that many decimals, or ABSENT."""
    return ABSENT if value is None else f"{value:.{decimals}f}".replace("-", _MINUS)


def format_percent(share: float | None, decimals: int = 2) -> str:
    """A share in percent, with decimals only below 100 %, or ABSENT."""
    if share is None:
        return ABSENT
    return f"{100.0 * share:.{decimals}f} %" if share < 1.0 else f"{100.0 * share:.0f} %"


def format_r2(r2: float | None) -> str:
    """R² with four decimals, or with one where it is far below zero."""
    if r2 is None:
        return ABSENT
    return f"{r2:.4f}".replace("-", _MINUS) if r2 > -10.0 else f"{r2:.1f}".replace("-", _MINUS)


def format_angle(degrees: float | None) -> str:
    """An angle with two digits or more, down to thousandths: "0.25°", "0.001°", "143°"; or ABSENT.

    Angles of a thousandth of a degree are those of rounded numbers.
    """
    if degrees is None:
        return ABSENT
    return f"{format_number(degrees, min(max(decimals_for(degrees) - 1, 0), 3))}°"


def format_amount(value: float | None, unit: str) -> str:
    """A value with two or more digits and its unit, milli-units if small: "0.21 N", "8.4 mN·m"."""
    if value is None:
        return ABSENT
    factor, scaled_unit = scale_for(value, unit)
    decimals = max(decimals_for(factor * value) - 1, 0)
    return f"{format_number(factor * value, decimals)} {scaled_unit}"


def scale_for(largest: float | None, unit: str) -> tuple[float, str]:
    """Factor and unit for numbers up to ``largest`` [unit]: milli-units below 0.1.

    The threshold is 0.0995, which rounds to 0.10 with two digits.
    """
    if largest is not None and 0.0 < largest < 0.0995 and " or " not in unit:
        return 1e3, f"m{unit}"
    return 1.0, unit


def decimals_for(magnitude: float) -> int:
    """Decimals that show three digits of a number of this magnitude: 2 for 4.2, 4 for 0.042."""
    if not magnitude > 0.0:
        return 2
    return min(max(2 - math.floor(math.log10(magnitude)), 0), 9)
