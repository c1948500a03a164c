"""Files, options, make targets and functions that documents and comments name must exist."""

import pkgutil
import re
import subprocess
from pathlib import Path

from support.page_lines import PAGES, ROOT, command_lines

import cdrj_ros as cdrj
from cdrj_ros.commands import check_robot, commission, identify_task, simulate, validate

KINDS = {".py", ".md", ".yaml", ".sh", ".xml", ".msg", ".srv", ".toml", ".txt", ".html"}
FOLDERS = "bags|bench|cdrj_ros|config|docs|examples|launch|msg_defs|requirements|test|tools"
FILE = re.compile(
    rf"(?<![\w/.:$}}-])((?:{FOLDERS})/[\w./-]*\w\.(?:py|md|yaml|json|xml|sh|txt|msg|png))\b"
)
TESTS = re.compile(r"(?<![\w/])(test_\w+\.py)\b")
MODULE = re.compile(r"`([a-z_]+/[a-z_]+\.py)`")
PARSERS = {
    "check_robot": check_robot._parser,
    "commission": commission._parser,
    "identify": identify_task.parser,
    "simulate": simulate.parser,
    "validate": validate._parser,
}


def sources():
    """Text files of the project; without a repository, as in an archive, the pages alone."""
    done = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    names = done.stdout.split("\0") if done.returncode == 0 else []
    found = (ROOT / name for name in names if Path(name).suffix in KINDS)
    return sorted({*PAGES, *(path for path in found if path.is_file())})


def test_files_that_a_document_a_comment_or_a_docstring_names_exist():
    folders_of_tests = tuple(path for path in (ROOT / "test").iterdir() if path.is_dir())
    missing, count = [], 0
    for path in sources():
        text = path.read_text()
        named = [(name, (ROOT,)) for name in FILE.findall(text)]
        named += [(name, (ROOT, ROOT / "cdrj_ros")) for name in MODULE.findall(text)]
        named += [(name, folders_of_tests) for name in TESTS.findall(text)]
        count += len(named)
        for name, folders in named:
            if not any((folder / name).exists() for folder in folders):
                missing.append(f"{path.relative_to(ROOT)}: {name}")
    assert missing == []
    assert count > 50


def test_selected_tests_exist():
    for page in (*PAGES, ROOT / "Makefile"):
        for name, word in re.findall(r"pytest .*?(test/\S+\.py)(?: -k (\w+))?", page.read_text()):
            assert word in "".join(re.findall(r"def (test_\w+)", (ROOT / name).read_text())), word


def test_options_of_commands_on_a_page_exist():
    for line in (line for page in PAGES for line in command_lines(page)):
        words = line.partition(" #")[0].removeprefix("ros2 run cdrj_ros ").split()
        if words and words[0] in PARSERS:
            known = PARSERS[words[0]]()._option_string_actions
            for option in (word for word in words if word.startswith("--")):
                assert option.partition("=")[0] in known, f"{words[0]} has no {option}"


def test_targets_of_make_on_a_page_exist():
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for page in PAGES:
        named = re.findall(r"(?:`|^)make ([a-z]+)", page.read_text(), re.MULTILINE)
        assert {*named} <= {*targets}, page


def test_functions_that_a_page_names_by_their_module_exist():
    rooms = "|".join(path.parent.name for path in (ROOT / "cdrj_ros").glob("*/__init__.py"))
    for page in PAGES:
        for name in re.findall(rf"`((?:{rooms})\.[a-z_]+\.\w+(?:\.\w+)?)`", page.read_text()):
            pkgutil.resolve_name(f"cdrj_ros.{name}")


def test_public_names_used_on_a_page_exist():
    for page in PAGES:
        named = re.findall(r"\bcdrj\.(?!launch|mcap)(\w+)", page.read_text())
        assert {*named} <= {*cdrj.__all__}, page


def test_pictures_and_pages_that_a_page_links_to_exist():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", page.read_text()):
            assert (page.parent / target).exists(), (page, target)
