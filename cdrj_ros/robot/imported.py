"""Robot files from a MuJoCo model, and the text of a robot file from its document."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Final

from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.output import printable, said_once
from cdrj_ros.foundation.yaml import Document, yaml_flow
from cdrj_ros.robot.mjcf import read_mjcf
from cdrj_ros.robot.reader import parse_robot

ASSUMED: Final = {
    "axial_stiffness": "assumed: EA [N], measure it by hanging a weight on the cable",
    "preload": "assumed: tension [N] at rest in the reference pose",
    "rest_length": "assumed: length [m] without tension",
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
    remarks = [*said_once(imported.remarks), *prefix_offered(imported.document)]
    text = robot_text(imported.document, remarks, Path(path).name)
    parse_robot(text, str(out))
    write_text(out, text)
    return tuple(remarks)


def prefix_offered(document: Document) -> Iterator[str]:
    """That ``prefix`` may stand for what the names of all motors and joints begin with."""
    names = [entry["name"] for kind in ("motors", "joints") for entry in document[kind]]
    begins = accumulate(names[0]) if len(names) > 1 else ()
    shared = [one for one in begins if all(name.startswith(one) for name in names)]
    ends = [one for one in shared if one[-1] in "_/" and one not in names]
    if ends:
        yield (
            f"the names of all motors and joints begin with {ends[-1]}: prefix: {ends[-1]} says it "
            "once, and another prefix makes the file one of another robot"
        )


def robot_text(document: Document, remarks: Sequence[str], source: str) -> str:
    """YAML text of a robot file, with numbers at full precision.

    Args:
        document: as the reader takes it, in SI.
        remarks: comment lines at the beginning.
        source: name of the model.
    """
    head = (
        f"Imported from {printable(source)} by import_robot.  Values marked as assumed are",
        "not in the model, and listed under assumed; take those that you replace off the list.",
        "Drums are assumed: their radii and the sign of winding; a cable leaves its drum at the",
        "tendon's first site.",
    )
    assumed = {*document.get("assumed", ())}
    cables = [line for cable in document["cables"] for line in _cable(cable, assumed)]
    return "\n".join([*beginning(document, remarks, head), "cables:", *cables]) + "\n"


def beginning(document: Document, remarks: Sequence[str], head: Sequence[str]) -> Iterator[str]:
    """Lines of a robot file before its cables.

    Args:
        document: as the reader takes it, in SI.
        remarks: comment lines, after those of the head.
        head: comment lines at the very beginning.
    """
    yield from (f"# {line}" for line in head)
    yield from (f"# - {printable(remark)}" for remark in remarks)
    yield f"name: {yaml_flow(document['name'])}"
    for key in ("motors", "joints", "frames"):
        entries = document[key]
        listed = isinstance(entries, list) and entries
        yield f"\n{key}:" if listed else f"\n{key}: {yaml_flow(entries)}"
        yield from (f"  - {yaml_flow(entry)}" for entry in entries if listed)
    if "assumed" in document:
        yield f"\nassumed: {yaml_flow(document['assumed'])}"
    yield "\nfriction:"
    yield from (_marked(key, value, "  ") for key, value in document["friction"].items())
    yield ""


def _cable(cable: Document, assumed: Collection[str]) -> Iterator[str]:
    yield f"  - name: {yaml_flow(cable['name'])}"
    for key in ("axial_stiffness", "preload", "rest_length"):
        if key in cable:
            marked = f"cables.{cable['name']}.{key}" in assumed
            line = _marked(key, cable[key], "    ")
            yield line if marked else line.partition("  #")[0]
    yield "    nodes:"
    yield from (f"      - {yaml_flow(node)}" for node in cable["nodes"])


def _marked(key: str, value: float, indent: str) -> str:
    return f"{indent}{key}: {yaml_flow(value)}  # {ASSUMED[key]}"
