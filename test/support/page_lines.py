"""Blocks and lines of the pages."""

import importlib.util
import re
import sys
from textwrap import dedent

from support.places import ROOT

PAGES = sorted(
    [*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("examples/**/*.md"),
     ROOT / "bags" / "README.md"]
)  # fmt: skip


def fenced(page):
    """Language and text of every block of a page, in order; indented ones are dedented."""
    text = page.read_text("utf-8")
    found = re.findall(r"^([ \t]*)```(\w*).*\n((?:.*\n)*?)\1```", text, re.MULTILINE)
    return [(language, dedent(content)) for _, language, content in found]


def blocks(page, wanted="bash"):
    """The blocks of a language on a page, in order."""
    return [text for language, text in fenced(ROOT / page) if language == wanted]


def command_lines(page):
    """The lines of the blocks of bash on a page; those that end with a backslash continue."""
    text = "".join(text for language, text in fenced(page) if language == "bash")
    return re.sub(r"\\\n", " ", text).splitlines()


def loaded_tool(path, **constants):
    """A script as a module, some of whose constants are replaced."""
    spec = importlib.util.spec_from_file_location(f"tool_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    for name, value in constants.items():
        assert hasattr(module, name), name
        setattr(module, name, value)
    return module


def shown_files(page):
    """The files that a page shows and tells to save, by name."""
    text = (ROOT / page).read_text("utf-8")
    named = r"Save (?:it|this one)\s+as\s+`([\w.]+)`[^`]*```\w+\n(.*?)```"
    return dict(re.findall(named, text, re.DOTALL))


def write_files(files, folder):
    """Save them."""
    for name, text in files.items():
        (folder / name).write_text(text, "utf-8")
