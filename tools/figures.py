"""Renew the pictures and figures of README.md and docs: `make figures`.

- runs the demonstration, which measures docs/demo.json;
- writes its errors into the table of README.md;
- takes a screenshot of the beginning of report.html as docs/report.png, with Chromium;
- draws docs/figures/fig*.png with examples/paper.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
MEASURED = ROOT / "docs" / "demo.json"
PICTURE = ROOT / "docs" / "report.png"
FIGURES = ROOT / "docs" / "figures"

WIDTH, HEIGHT = 1265, 1245
"""Size of the report's picture [px]."""

WITHOUT_TABLES = "<style>.tables, .tables ~ *, dl.rows, h2:has(+ .tables) { display: none }</style>"
"""Style that hides the tables of a report."""

BROWSERS = ("chromium", "chromium-browser", "google-chrome")

Channels = Mapping[str, Mapping[str, Any]]


def _percent(channels: Channels, *names: str) -> str:
    return " / ".join(f"{100.0 * channels[name]['mean_relative_error']:.2f} %" for name in names)


def _mean(channels: Channels) -> str:
    errors = [
        one["mean_relative_error"] for name, one in channels.items() if name.startswith("tension/")
    ]
    return f"{100.0 * sum(errors) / len(errors):.2f} %"


ROWS: Mapping[str, Callable[[Channels], str]] = {
    "last element of the upper / lower cable": lambda c: _percent(
        c, "tension/upper/8", "tension/lower/8"
    ),
    "all 16 element tensions": _mean,
    "third nodal force, upper / lower": lambda c: _percent(
        c, "nodal_force/upper/3", "nodal_force/lower/3"
    ),
}
"""Rows of the README's table of errors, and how the second cell is computed."""


def readme_with(text: str, channels: Channels) -> str:
    """README.md with the errors of the demonstration.

    Raises:
        ValueError: a row is missing.
    """
    for label, cell in ROWS.items():
        row = re.compile(rf"^(\| {re.escape(label)} \|) [^|]* \|", re.MULTILINE)
        text, found = row.subn(rf"\1 {cell(channels)} |", text)
        if found != 1:
            raise ValueError(f"README.md has {found} rows {label!r}, expected 1")
    return text


def picture_report(browser: str) -> None:
    """Take a screenshot of the beginning of report.html without its tables."""
    page = (ROOT / "report.html").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        shown = Path(folder) / "report.html"
        shown.write_text(page.replace("</head>", f"{WITHOUT_TABLES}</head>", 1), encoding="utf-8")
        command = [
            browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            f"--window-size={WIDTH},{HEIGHT}", f"--screenshot={PICTURE}", shown.as_uri(),
        ]  # fmt: skip
        subprocess.run(command, check=True, capture_output=True, timeout=120)


def run(*command: object) -> None:
    """Run one of the project's programs; raise an error if it fails."""
    subprocess.run([str(part) for part in command], cwd=ROOT, check=True)


def main() -> int:
    """Renew everything; returns the exit code."""
    run(sys.executable, ROOT / "tools" / "demo.py")
    channels = json.loads(MEASURED.read_text(encoding="utf-8"))["channels"]
    text = README.read_text(encoding="utf-8")
    README.write_text(readme_with(text, channels), encoding="utf-8")
    browser = next((name for name in BROWSERS if shutil.which(name)), None)
    if browser:
        picture_report(browser)
    else:
        print(f"{PICTURE} is not renewed: none of {', '.join(BROWSERS)} is on the path")
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "examples.paper", "--out", folder, "--force")
        for drawn in Path(folder).glob("fig*.png"):
            shutil.copy(drawn, FIGURES / drawn.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
