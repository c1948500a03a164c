"""Measure the estimator's speed against its peers, and write the table of docs/speed.md."""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

from bench.figures import ROOT
from bench.roundtrip import isolate
from cdrj_ros.foundation.files import write_text

PAGE = ROOT / "docs" / "speed.md"
BEGIN = "<!-- Written by `make bench`; changes are lost. -->"
END = "<!-- End of what `make bench` writes. -->"
COMPARED = ("numpy", "rclpy", "mujoco", "rosbags", "mcap")
"""Packages whose versions are written."""


SECTIONS = {
    "step": ("update", "one update beside MuJoCo's, and of 10 000 pulleys"),
    "node": ("roundtrip", "the node's round trip"),
    "offline": ("offline", "a 200 s bag beside rosbags, fits of it and of a hand"),
    "hand": ("hand", "a hand beside its fingers"),
}
"""Modules, and texts of their progress lines."""


def _arguments():
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument(
        "--only", metavar="NAME,...",
        help=f"sections to measure, of {','.join(SECTIONS)}; docs/speed.md is then left alone",
    )  # fmt: skip
    arguments = parser.parse_args()
    arguments.whole = arguments.only is None
    arguments.only = arguments.only.split(",") if arguments.only else list(SECTIONS)
    if unknown := [name for name in arguments.only if name not in SECTIONS]:
        parser.error(f"--only takes {', '.join(SECTIONS)}; got {', '.join(unknown)}")
    return arguments


def machine():
    """Processor, cores, kernel, versions and load of this machine."""
    model = platform.machine()
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
            break
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    return (
        f"Measured on: {model}, {cores} cores, Linux {platform.release()}, Python "
        f"{platform.python_version()}, load average {load:.1f} at the start. Versions: "
        f"{', '.join(f'{name} {version(name)}' for name in COMPARED)}."
    )


def written(rows, where, failed):
    """Machine, versions and table, in Markdown."""
    lines = [
        where,
        "",
        "Ratio: ours over theirs. Medians.",
        "",
        "| what | ours | beside | theirs | ratio | aim |",
        "|---|---|---|---|---|---|",
        *(row.line() for row in rows),
        "",
    ]
    if failed:
        lines += ["**Not measured**", "", *(f"- {text}" for text in failed), ""]
    return "\n".join(lines)


def main():
    """Run the sections; the exit code is 1 if one failed and does not depend on speed."""
    arguments = _arguments()
    isolate()
    where, rows, failed = machine(), [], []
    for name in arguments.only:
        module, said = SECTIONS[name]
        print(f"{name}: {said} ...", flush=True)
        try:
            rows += import_module(f"bench.{module}").measure()
        except (RuntimeError, OSError, ImportError, subprocess.SubprocessError) as error:
            failed.append(f"{said}: {error}")
    text = written(rows, where, failed)
    print(text)
    if arguments.whole:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        _, _, after = rest.partition(END)
        write_text(PAGE, f"{before}{BEGIN}\n\n{text}\n{END}{after}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
