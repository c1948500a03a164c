"""Names of the compared quantities of an estimate: ``tension/upper/8``, ``effort/spindle``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from cdrj_ros.model.prepared import Layout

TENSION: Final = "tension"
"""``tension/cable/element`` [N]."""
NODAL_FORCE: Final = "nodal_force"
"""``nodal_force/cable/node``, the magnitude [N]."""
EFFORT: Final = "effort"
"""``effort/motor`` or ``effort/joint`` [N m], [N] for a prismatic joint."""


def channel_columns(layout: Layout) -> dict[str, int]:
    """Columns of tensions, nodal forces, motor and joint efforts in an estimate, by channel."""
    named: dict[str, int] = {}
    for prefix, names, where in (
        (TENSION, layout.elements, layout.tension),
        (NODAL_FORCE, layout.pulleys, layout.magnitude),
        (EFFORT, layout.motors, layout.motor_effort),
        (EFFORT, layout.joints, layout.joint_effort),
    ):
        named |= {f"{prefix}/{name}": where.start + k for k, name in enumerate(names)}
    return named
