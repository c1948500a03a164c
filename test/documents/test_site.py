"""The site of the documentation builds without a warning and needs no other machine."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML
from support.places import ROOT

OTHERS = re.compile(
    r"""<(?:script|img|iframe)\b[^>]*\bsrc=["']?(?:https?:)?//
    |<link\b(?=[^>]*\brel=["']?(?:stylesheet|preconnect|preload|icon))[^>]*\bhref=["']?(?:https?:)?//
    |@import\s+(?:url\()?["']?(?:https?:)?//""",
    re.VERBOSE,
)
"""What makes a browser request something from another machine when it opens a page."""


def pages_of(nav: list[object]) -> list[str]:
    found: list[str] = []
    for entry in nav:
        if isinstance(entry, str):
            found.append(entry)
        elif isinstance(entry, dict):
            for value in entry.values():
                found += [value] if isinstance(value, str) else pages_of(value)
    return found


def test_every_page_is_in_the_navigation_once() -> None:
    listed = pages_of(YAML(typ="safe").load((ROOT / "mkdocs.yml").read_text())["nav"])
    assert sorted(listed) == sorted(path.name for path in (ROOT / "docs").glob("*.md"))


@pytest.mark.skipif(
    not all(importlib.util.find_spec(name) for name in ("mkdocs", "material", "mkdocstrings")),
    reason="mkdocs-material and mkdocstrings are not installed (make docs)",
)
def test_the_site_builds_without_a_warning_and_requests_nothing_from_other_machines(
    tmp_path: Path,
) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    pages = sorted(tmp_path.rglob("*.html"))
    assert len(pages) > 20
    for page in pages:
        assert not OTHERS.search(page.read_text()), page.name
    assert not any(OTHERS.search(path.read_text()) for path in tmp_path.rglob("*.css"))
    api = (tmp_path / "api.html").read_text()
    for name in ("load", "Estimator", "step", "read_recording"):
        assert f'.{name}"' in api, name
    assert "t_i = EA max(L_i / l_i − 1, 0)" in (tmp_path / "model.html").read_text()
