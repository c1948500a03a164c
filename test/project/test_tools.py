"""Every tool of the repository finds the names that it imports, and says what it does."""

import runpy
import sys

import pytest
from support.places import ROOT

TOOLS = sorted((ROOT / "tools").glob("*.py"))


@pytest.mark.parametrize("tool", TOOLS, ids=lambda path: path.name)
def test_a_tool_finds_what_it_imports(tool, monkeypatch):
    monkeypatch.syspath_prepend(tool.parent)
    monkeypatch.setattr(sys, "argv", [str(tool)])
    assert runpy.run_path(str(tool))["__doc__"]
