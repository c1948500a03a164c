"""The page of check_robot: drawing, tables and suspicions of one robot."""

from __future__ import annotations

import os
from collections.abc import Sequence

from cdrj_ros.foundation.files import write_text
from cdrj_ros.foundation.text import counted
from cdrj_ros.inspection.checks import Inspection, Suspicion
from cdrj_ros.report.cable_tables import cable_tables, headline
from cdrj_ros.report.parameters import parameter_tables
from cdrj_ros.report.pictures import drawing_svg
from cdrj_ros.report.templates import style, template


def write_robot_page(
    path: str | os.PathLike[str], inspection: Inspection, suspicions: Sequence[Suspicion]
) -> None:
    """Write one self-contained HTML page on a robot, whole or not at all.

    Args:
        path: the file, replaced if it exists.
        inspection: of ``cdrj_ros.inspection.ranges``.
        suspicions: of ``cdrj_ros.inspection.suspicions``.

    Raises:
        OSError: the file cannot be written; an existing file is then kept.
    """
    from cdrj_ros.report.drawing import draw_robot

    robot = inspection.model.robot
    grave = [entry for entry in suspicions if entry.grave]
    page = template("robot.html").render(
        title=robot.name,
        style=style(),
        headline=headline(inspection),
        verdict=f"{counted(len(grave), 'suspicious value')}" if grave else "nothing suspicious",
        grave=_by_name(grave),
        remarks=_by_name([entry for entry in suspicions if not entry.grave]),
        drawing=drawing_svg(draw_robot(inspection), f"Cables of {robot.name}"),
        cables=cable_tables(inspection),
        parameters=parameter_tables(robot),
    )
    write_text(path, page + "\n")


def _by_name(suspicions: Sequence[Suspicion]) -> dict[str, str]:
    """Texts by the name of what they concern."""
    texts: dict[str, str] = {}
    for entry in suspicions:
        texts[entry.where] = "; ".join(filter(None, (texts.get(entry.where), entry.text)))
    return texts
