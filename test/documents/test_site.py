"""Every page is in the navigation of the site, which `make docs` builds strictly."""

from __future__ import annotations

from ruamel.yaml import YAML
from support.places import ROOT


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
