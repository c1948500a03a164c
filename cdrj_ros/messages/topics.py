"""Names of the topics in the namespace of the nodes."""

from __future__ import annotations

from typing import Final

NAMESPACE: Final = "cdrj"
"""Namespace of every node unless it is remapped."""

MOTOR_STATES: Final = "motor_states"
"""Motor angles, JointState."""
JOINT_STATES: Final = "joint_states"
"""Joint angles, JointState."""
JOINT_ANGLES: Final = "joint_angles"
"""Estimated angles of joints without encoder, JointState."""
TENSION_SENSORS: Final = "tension_sensors"
"""Readings of load cells, CableTensions."""
TENSIONS: Final = "tensions"
"""Estimates, CableTensions."""
NODAL_FORCES: Final = "nodal_forces"
"""Estimates, NodalForces."""
EFFORTS: Final = "efforts"
"""Estimates, JointState."""
TENSION_STATES: Final = "tension_states"
"""Tensions as efforts of a JointState, on request."""
WRENCHES: Final = "wrenches"
"""Namespace of the forces on pulleys, one WrenchStamped each, on request."""
TRUTH: Final = "truth"
"""Namespace of what a simulated rig knows and no robot publishes."""
STATES: Final = "states"
"""True angles, speeds and efforts there, JointState."""

BROADCAST: Final = "/joint_states"
"""Motors and joints together, JointState, from ros2_control's joint_state_broadcaster."""
CLOCK: Final = "/clock"
"""Simulated time."""
DIAGNOSTICS: Final = "/diagnostics"
"""State of the nodes, DiagnosticArray."""
FEW: Final = 10
"""Queue depth of ``CLOCK`` and ``DIAGNOSTICS`` [messages]."""


def in_namespace(name: str) -> str:
    """Absolute name of a topic or node in the default namespace."""
    return f"/{NAMESPACE}/{name}"
