"""docs/model.md, examples/paper/derivation.md and the code refer to the same equations."""

import ast
import inspect
import pkgutil
import re

from support.places import ROOT

HEADING = "Where each equation is computed"
PAGES = [
    (ROOT / page).read_text(encoding="utf-8")
    for page in ("docs/model.md", "examples/paper/derivation.md")
]
SOURCES = [
    *sorted(
        path
        for folder in ("model", "conditioning", "estimation", "identification")
        for path in (ROOT / "cdrj_ros" / folder).rglob("*.py")
    ),
    *sorted((ROOT / "cdrj_ros" / "core").glob("*.?pp")),
    ROOT / "examples" / "paper" / "stiffness.py",
]
CITATION = re.compile(r"\((E?)(\d{1,2})\)(?:\s?[-–]\s?\(E?(\d{1,2})\))?")


def equations(text):
    """Numbers of all equations cited, ranges written out: (4), (29)-(31), (E2)."""
    found = set()
    for letter, first, last in CITATION.findall(text):
        found |= {f"{letter}{n}" for n in range(int(first), int(last or first) + 1)}
    return found


def remarks(path):
    """All docstrings of modules, classes, functions and fields, or all comments in C++."""
    if path.suffix != ".py":
        return "\n".join(re.findall(r"//.*", path.read_text(encoding="utf-8")))
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return "\n".join(
        node.value.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def remarks_on(name):
    """What is said about a function, or in a file of the core, such as ``core/cable.hpp``."""
    if "/" in name:
        return remarks(ROOT / "cdrj_ros" / name)
    found = resolved(name)
    assert callable(found)
    return inspect.getdoc(found) or ""


def resolved(name):
    """The object of a dotted name below ``cdrj_ros``, or below ``examples``."""
    return pkgutil.resolve_name(name if name.startswith("examples.") else f"cdrj_ros.{name}")


def computed():
    """Functions by equation, from the tables of both pages."""
    table = {}
    sections = "".join(page[page.rindex(HEADING) :] for page in PAGES)
    for line in sections.splitlines():
        cells = line.split("|")
        if line.startswith("| ("):
            for number in equations(cells[1]):
                table.setdefault(number, []).extend(re.findall(r"`([\w./]+)`", cells[2]))
    return table


def test_every_equation_has_a_function_and_every_function_an_equation():
    table = computed()
    assert all(table.values())
    derived = "".join(page[: page.rindex(HEADING)] for page in PAGES)
    assert equations(derived) == set(table)
    assert {str(n) for n in range(1, 45)} <= set(table), "none of the source's is left out"
    ours = sorted(int(number[1:]) for number in table if number.startswith("E"))
    assert ours == list(range(1, len(ours) + 1))


def test_a_function_of_an_equation_cites_it():
    for number, names in computed().items():
        assert number in equations("\n".join(map(remarks_on, names))), number


def test_every_equation_cited_in_the_code_is_in_the_document():
    known = equations("".join(PAGES))
    for path in SOURCES:
        assert equations(remarks(path)) <= known, path
