"""Names of the package and files named in the documents must exist."""

import re
from pathlib import Path

import pytest

import cdrj_ros as cdrj

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), ROOT / "bags" / "README.md"])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_public_names_used_on_a_page_exist(page: Path) -> None:
    for name in re.findall(r"\bcdrj\.(?!launch|mcap)(\w+)", page.read_text()):
        assert name in cdrj.__all__, name


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_pictures_and_pages_that_a_page_links_to_exist(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target
