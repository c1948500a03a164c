"""Text of a robot file from a document, with comments that mark assumed values."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.text import printable
from cdrj_ros.foundation.yaml import Document
from cdrj_ros.robot.mjcf import read_mjcf
from cdrj_ros.robot.reader import parse_robot

_PLAIN: Final = re.compile(r"(?i)^(?!(y|n|yes|no|on|off|true|false|null)$)[a-z_][a-z0-9_./-]*$")
"""Texts that YAML takes as they are."""

ASSUMED: Final = {
    "axial_stiffness": "assumed: EA [N], measure it by hanging a weight on the cable",
    "preload": "assumed: tension [N] at rest in the reference pose",
    "mu_c": "assumed: Coulomb coefficient of the cable on what it touches",
}
"""Comments on keys that models of other programs do not have."""


def import_mjcf(
    path: str | Path, out: str | Path, tendons: Sequence[str] | None = None
) -> tuple[str, ...]:
    """Turn a MuJoCo model's spatial tendons into the cables of a robot file, docs/robot_file.md.

    Args:
        path: MJCF file.
        out: robot file to write; values that the model does not have are marked as assumed.
        tendons: names of those that become cables; None for all.

    Returns:
        Remarks on what the robot file does not represent.

    Raises:
        UsageError: MuJoCo is not installed, or cannot read the model within the limits of time and
            memory, or no tendon can be represented.
        RobotFileError: the result would be no possible robot.
    """
    imported = read_mjcf(path, tendons)
    text = robot_text(imported.document, imported.remarks, Path(path).name)
    parse_robot(text, str(out))
    write_text(out, text)
    return tuple(imported.remarks)


def robot_text(document: Document, remarks: Sequence[str], source: str) -> str:
    """YAML text of a robot file, with numbers at full precision.

    Args:
        document: as the reader takes it, in SI.
        remarks: comment lines at the beginning.
        source: name of the model.
    """
    lines = [f"# Imported from {printable(source)} by import_robot.  Values marked as assumed are"]
    lines += [
        "# not in the model.  The drums are assumed: their radii and the sign of winding, and"
    ]
    lines += ["# the names of the motors; a cable leaves its drum at the tendon's first site."]
    lines += [f"# - {printable(remark)}" for remark in remarks]
    lines += [f"name: {document['name']}", "", "motors:"]
    lines += [f"  - {flow(motor)}" for motor in document["motors"]]
    lines += ["", "joints:" if document["joints"] else "joints: []"]
    lines += [f"  - {flow(joint)}" for joint in document["joints"]]
    lines += ["", "frames:" if document["frames"] else "frames: []"]
    lines += [f"  - {flow(frame)}" for frame in document["frames"]]
    lines += ["", "friction:"]
    lines += [_assumed(key, value, "  ") for key, value in document["friction"].items()]
    lines += ["", "cables:"]
    for cable in document["cables"]:
        lines += [f"  - name: {cable['name']}"]
        lines += [_assumed(key, cable[key], "    ") for key in ("axial_stiffness", "preload")]
        lines += ["    nodes:"]
        lines += [f"      - {flow(node)}" for node in cable["nodes"]]
    return "\n".join(lines) + "\n"


def _assumed(key: str, value: float, indent: str) -> str:
    return f"{indent}{key}: {flow(value)}  # {ASSUMED[key]}"


def flow(value: Any) -> str:
    """A value in YAML's flow style; floats have a decimal point, which YAML 1.1 requires."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {flow(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(flow, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = repr(value)
        mantissa, exponent, power = text.partition("e")
        return mantissa + (".0" if exponent and "." not in mantissa else "") + exponent + power
    if isinstance(value, str) and not _PLAIN.match(value):
        return json.dumps(value)
    return str(value)
