"""The table of docs/speed.md, between two marker comments."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

from bench.figures import Row, Spread

BEGIN = "<!-- Written by `make bench`; changes are lost. -->"
END = "<!-- End of what `make bench` writes. -->"

COMPARED = ("numpy", "rclpy", "mujoco", "exudyn", "opensim", "rosbags", "mcap")


def versions() -> str:
    """Names and versions of the packages that are compared."""
    found = []
    for name in COMPARED:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return ", ".join(found)


def _figure(spread: Spread | None, unit: str = "") -> str:
    return f"{spread.median:#.3g}".rstrip(".") + f" {unit}".rstrip() if spread else ""


def _line(row: Row) -> str:
    fields = (
        row.what, _figure(row.ours, row.unit), row.beside, _figure(row.theirs, row.unit),
        _figure(row.ratio), row.aim + (" **missed**" if row.missed else ""),
    )  # fmt: skip
    return "| " + " | ".join(fields) + " |"


def written(rows: Sequence[Row], machine: str, compared: str, failed: Sequence[str]) -> str:
    """Machine, versions and table, in Markdown."""
    lines = [
        f"Measured on: {machine}. Versions: {compared}.",
        "",
        "Ratio: ours over theirs. Medians. The JSON has quartiles, and figures beside nothing.",
        "",
        "| what | ours | beside | theirs | ratio | aim |",
        "|---|---|---|---|---|---|",
        *(_line(row) for row in rows if row.ratio or row.aim),
        "",
    ]
    if failed:
        lines += ["**Not measured**", "", *(f"- {text}" for text in failed), ""]
    return "\n".join(lines)


def renewed(page: str, text: str) -> str:
    """Replace the text between the markers of the page.

    Raises:
        ValueError: the page does not have both markers, in order.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise ValueError(f"the page needs the lines {BEGIN} and {END}")
    return f"{before}{BEGIN}\n\n{text}\n{END}{after}"
