"""Modules and files named in the documents must exist."""

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), ROOT / "bags" / "README.md"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_imports_shown_on_a_page_succeed(page: Path) -> None:
    for module, names in re.findall(r"from (cdrj_ros[\w.]*) import ([\w, ]+)", page.read_text()):
        room = importlib.import_module(module)
        for name in names.split(","):
            assert hasattr(room, name.strip()), f"{module} has no {name.strip()}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pictures_and_pages_that_a_page_links_to_exist(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_the_pages_show_imports_and_link_to_pictures() -> None:
    texts = "".join(page.read_text() for page in PAGES)
    assert "from cdrj_ros." in texts
    assert "](figures/" in texts
