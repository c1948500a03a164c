"""Plain YAML has the value that ruamel.yaml gives, and what is not plain is left to ruamel.yaml."""

from __future__ import annotations

from pathlib import Path
from random import Random
from textwrap import dedent
from typing import Any

import pytest

from cdrj_ros.foundation.any_yaml import any_yaml
from cdrj_ros.foundation.plain_yaml import NotPlainError, plain_yaml
from cdrj_ros.foundation.yaml import MAXIMUM_DEPTH, MAXIMUM_NODES

FILES = sorted((Path(__file__).parents[2] / "config" / "robots").glob("*.yaml"))
LINES = [
    line
    for path in FILES
    for line in path.read_text("utf-8").splitlines(keepends=True)
    if len(line) < 120
]
SIGNS = (
    *"{}[]:,#&*!|>'\"%@`-?\n.~=<\t\\", "\n  ", "\n- ", ": ", "- ", "? ", "1", "key", "[1, 2]", "+1",
    " #c", "--- ", "...", "<<: ", "null", "yes", "0o17", "1e3", "012", "1_000", ".5", "{a: 1}",
    "1:30", "2020-01-02", "é", "\u2028",
)  # fmt: skip
LIKELY = ("a: ", "b: ", "- ", "\n", "  ", "1", "x", "[", "]", "{", "}", ", ", "? ", " #", "'q'")


def read_plain(text: str) -> Any:
    return plain_yaml(text, MAXIMUM_NODES, MAXIMUM_DEPTH)


def is_alike(text: str) -> bool:
    """Whether the text is plain; fails if it then has another value for ruamel.yaml."""
    try:
        value = read_plain(text)
    except NotPlainError:
        return False
    # the text of a value has its types and the order of its keys as well
    assert repr(value) == repr(any_yaml(text)), repr(text)
    return True


def damaged(text: str, rng: Random) -> str:
    """The text with a sign inserted, characters removed, or a blank moved, up to four times."""
    for _ in range(rng.randrange(5)):
        at = rng.randrange(len(text) + 1)
        new = rng.choice((rng.choice(SIGNS), "", " " * rng.randrange(5), "\n"))
        text = text[:at] + new + text[at + rng.choice((0, 0, 1, 4)) :]
    return text


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_installed_robot_file_is_plain(path: Path) -> None:
    assert is_alike(path.read_text("utf-8"))


def test_damaged_parts_of_robot_files_have_one_value() -> None:
    rng = Random(1)
    plain = 0
    for _ in range(1500):
        begin = rng.randrange(len(LINES))
        lines = LINES[begin : begin + rng.randrange(1, 8)]
        plain += is_alike(damaged(dedent("".join(lines)), rng))
    assert plain > 150


@pytest.mark.parametrize("parts", [SIGNS, LIKELY], ids=["signs", "likely"])
def test_any_sequence_of_signs_has_one_value(parts: tuple[str, ...]) -> None:
    rng = Random(1)
    plain = sum(
        is_alike("".join(rng.choice(parts) for _ in range(rng.randrange(1, 12))))
        for _ in range(10_000)
    )
    assert plain > 150


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("[yes, no, on, off, y, N]", ["yes", "no", "on", "off", "y", "N"]),
        ("[true, False, NULL, nUll]", [True, False, None, "nUll"]),
        ("[0, -0, 12, -0.0, 1., 1e3, 1.5E-2]", [0, 0, 12, -0.0, 1.0, 1000.0, 0.015]),
        ("[2020-01-02-03, 1.10 N, /x/y_1]", ["2020-01-02-03", "1.10 N", "/x/y_1"]),
        ("a: " + "9" * 30, {"a": int("9" * 30)}),
    ],
)
def test_scalars_have_the_types_of_yaml_1_2(text: str, value: Any) -> None:
    assert repr(read_plain(text)) == repr(any_yaml(text)) == repr(value)


@pytest.mark.parametrize(
    "text",
    [
        "a: 017", "a: 0o17", "a: 0x1f", "a: 1_000", "a: +1", "a: .5", "a: .nan", "a: 1:30", "a: ~",
        "a: 1e", "a: 2020-13-01", "a: 2020-01-02 03:04:05", "a: 1\na: 2", "<<: {a: 1}", "a: =",
        "a: &b 1", "a: *b", "a: !!str 1", "a: |\n  b", 'a: "\\n"', "a:\t1", "[a]: 1", "1: a",
        "%YAML 1.1\n---\na: 1", "--- a", "a: 1\n...", "- 1\n...\n...", "a: 1\r\n", "a: \x85",
        "a: [", "a: " + "9" * 31, "k" * 200 + ": 1", "[" * 60 + "]" * 60, "- 1\n" * MAXIMUM_NODES,
        "\ufeffa: 1",
    ],
)  # fmt: skip
def test_a_text_that_is_not_plain_is_left_to_ruamel(text: str) -> None:
    with pytest.raises(NotPlainError):
        read_plain(text)


def test_without_libyaml_everything_is_left_to_ruamel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cdrj_ros.foundation.plain_yaml._PARSER", None)
    with pytest.raises(NotPlainError):
        read_plain("a: 1")
