"""The table of docs/speed.md, between two marker comments."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

from bench.figures import Row, Spread

BEGIN = "<!-- Written by `make bench`; changes are lost. -->"
END = "<!-- End of what `make bench` writes. -->"

COMPARED = ("numpy", "rclpy", "mujoco", "exudyn", "opensim", "rosbags", "mcap")

NODE = (
    "the interpreter's part of the callbacks, which take up to three times as long between other "
    "processes, whose data fill the caches, as in a loop; see below"
)
LIMITS = {
    "one update, 2 cables": "the call from Python and its results; see the update in bulk",
    "one update with": "the step of a member, at every third sample",
    "one update, 2 imported": (
        "geometry in space takes half of it, spread over the points of contact (19 %), wraps and "
        "middles of arcs (8 %) and the rest (23 %); what remains is that of cables in the plane"
    ),
    "validate as": (
        "estimates and standard deviations of 300 000 samples take two thirds of it, the start of "
        "Python and its imports a quarter"
    ),
    "1 kHz, until": NODE,
    "processor time": NODE,
    "sustained rate, no": "the node's processor time per sample, see above",
    "validate, 6 bags": (
        "imports, and a first bag for which every process loads the robot itself; a command of its "
        "own on each processor, in the row below, shows what the machine gives"
    ),
    "start of the estimator: more": (
        "the modules of the package, the robot file, and more publishers, subscriptions and "
        "services than a bare node has"
    ),
    "memory of the estimator: more": "the modules of the package and what they import",
    "make demo from": (
        "the files that bind the core to Python take half of the compiler's time; two thirds of "
        "the time of the messages go to their generation in Python; a third of that of the "
        "demonstration goes to the pictures of its report, and most of the rest to rclpy and the "
        "middleware below: 90 000 messages to another process, and the answers"
    ),
    "make test, whole": (
        "2000 tests that take some 330 s of processor time on a machine that adds ten million "
        "numbers in 0.3 s, a third of it in those of the estimation, which simulate the truth that "
        "they compare with; a further worker gains nothing"
    ),
    "10 000 whole pulleys": "Newton's method gives up even with softened bristles",
}
"""Limits of the figures according to earlier profiles, by the beginning of the row's name."""

MISSED = (
    "**Aims missed.** The limits are those of earlier profiles; this run does not measure them."
)


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


def _limit(row: Row) -> str:
    value = (row.ratio or row.ours).median
    because = [text for what, text in LIMITS.items() if row.what.startswith(what)]
    limit = because[0] if because else "not profiled"
    return f"- {row.what}: {value:.3g}, aim {row.aim}. Limit: {limit}."


def written(rows: Sequence[Row], machine: str, compared: str, failed: Sequence[str]) -> str:
    """Machine, versions, table and missed aims, in Markdown."""
    lines = [
        f"Measured on: {machine}. Versions: {compared}.",
        "",
        "Ratio: ours over theirs. Medians; the JSON has the quartiles.",
        "",
        "| what | ours | beside | theirs | ratio | aim |",
        "|---|---|---|---|---|---|",
        *(_line(row) for row in rows),
        "",
    ]
    if missed := [_limit(row) for row in rows if row.missed]:
        lines += [MISSED, "", *missed, ""]
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
