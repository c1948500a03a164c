"""The table of docs/speed.md, between two marker comments."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version

from bench.figures import Row, Spread

BEGIN = "<!-- Written by `make bench`; changes are lost. -->"
END = "<!-- End of what `make bench` writes. -->"

COMPARED = ("numpy", "numba", "rclpy", "mujoco", "exudyn", "opensim", "rosbags", "mcap")

NODE = (
    "the interpreter's part of the callbacks, which take up to three times as long between other "
    "processes, whose data fill the caches, as in a loop; see below"
)
LIMITS = {
    "one update, 2 cables": "the call from Python and its results; see the update in bulk",
    "one update with": (
        "the step of a member, at every second sample, and a call from Python with all 24 arrays "
        "of the members"
    ),
    "1 kHz, until": NODE,
    "processor time": NODE,
    "sustained rate, no": "the node's processor time per sample, see above",
    "validate as a command": (
        "imports take 27 % of the time, estimating and comparing 38 %, reading and conditioning "
        "13 %, the robot file and loading the kernels 8 %, the end of the interpreter 7 %, the "
        "printed table 4 %"
    ),
    "validate, 6 bags": (
        "of 4.8 s, imports take the first 0.46 s, the first bag of each process 1.47 s, in which "
        "it loads robot and kernels, every other one 1.3 s (1.25 s on one processor), tables and "
        "end 0.15 s; a command of its own on each processor, in the row below, shows what the "
        "machine gives"
    ),
    "second start of the estimator: more": (
        "importing numba and the package takes two thirds of it, the robot file and loading the "
        "kernels the rest; a machine on which the bare node starts in 0.17 s needs 0.30 s more"
    ),
    "first start without a compiled kernel, until it estimates": (
        "compilation of the step in one process, and of the geometry in the plane and the solution "
        "of a cable in another: 9 s of processor time in all on a machine that adds ten million "
        "numbers in 0.36 s, 60 % of it numba's analysis in Python; see below; `colcon build` and "
        "`make demo` do it in advance"
    ),
    "first start without a compiled kernel, until its first": (
        "the start of Python and the imports of rclpy and numba; a bare node is not ready sooner "
        "than in half of this"
    ),
    "memory of the estimator: more": (
        "LLVM's library takes 70 MB, of which 23 MB are for the run-time system that numba "
        "compiles at every start; all of its pages can be discarded and read again"
    ),
    "make demo from": (
        "of the processor time the kernels take two fifths and the messages a quarter, two thirds "
        "of that for their generation in Python; the demonstration alone, 90 000 messages to "
        "another process and the answers, takes three tenths, half of it in rclpy and the "
        "middleware below"
    ),
    "make test, whole": (
        "4700 tests that take 500 to 600 s of processor time on a machine that adds ten million "
        "numbers in 0.3 s, three quarters of it in the processes of the tests themselves, and no "
        "test with more than 4 %; a further worker gains nothing"
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
