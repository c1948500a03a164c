"""Colours, opacities and text sizes that both kinds of robot drawing share."""

from __future__ import annotations

from typing import Final

CABLE_COLOURS: Final = (
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#5e4fa2", "#7f7f7f",
)  # fmt: skip
"""Colours of cables after Okabe and Ito, distinguishable for colour-blind readers; they repeat if
there are more cables."""

INK: Final = "#1c1c1a"
MUTED: Final = "#62625d"
RULE: Final = "#b9b9b5"
RULE_LIGHT: Final = "#e6e6e2"
BODY: Final = "#e9e7df"

FONT_SIZE: Final = 12.0
"""Size of text [px]."""


def cable_colour(index: int) -> str:
    """Colour of the cable with this index in the robot."""
    return CABLE_COLOURS[index % len(CABLE_COLOURS)]
