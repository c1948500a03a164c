"""Untrusted YAML gives a value or a one-line error, in bounded time and memory."""

import re
import tracemalloc
import warnings
from datetime import date
from random import Random

import pytest
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from support.places import ROBOTS

from cdrj_ros.foundation.yaml import MAXIMUM_NODES, YamlError, load_yaml

MOST_MEMORY = 50e6
"""Memory for texts of a few kilobytes [bytes]."""


def nested(last, step, levels=12):
    """`levels` anchored entries, each of which repeats the previous one ten times."""
    lines = [f"a0: &a0 {last}"]
    lines += [
        f"a{level}: &a{level} " + step.format(",".join([f"*a{level - 1}"] * 10))
        for level in range(1, levels)
    ]
    return "\n".join(lines) + "\n"


BOMBS = {
    "aliases": nested("[x]", "[{}]"),
    "aliases as values": nested("{k: 1}", "{{k: [{}]}}"),
    "merge keys": nested("{k: 1, l: 2}", "{{<<: [{}]}}"),
    "brackets": "[" * 20_000,
    "closed brackets": "[" * 20_000 + "]" * 20_000,
    "block sequence": "- " * 20_000,
    "a list that contains itself": "&a [*a]",
    "a merge of itself": "&a {<<: *a}",
    "depth by aliases": "\n".join(
        ["a0: &a0 [x]"] + [f"a{k}: &a{k} [*a{k - 1}]" for k in range(1, 500)]
    ),
    "a long integer": "a: " + "9" * 5000,
    "a long hexadecimal integer": "a: 0x" + "f" * 5000,
    "a large text": "#" * 2_000_000,
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_text_that_expands_too_far_is_refused_in_one_line(name):
    tracemalloc.start()
    try:
        with pytest.raises(YamlError, match=r"^robot\.yaml ") as caught:
            load_yaml(BOMBS[name], "robot.yaml")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < MOST_MEMORY
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 51 + "]" * 51, "is nested more than 50 deep$"),
        ("a: &a " + "[" * 30 + "]" * 30 + "\nb: " + "[" * 30 + "*a" + "]" * 30, "deep by aliases$"),
        ("- 1\n" * MAXIMUM_NODES + "[", "has more than 100000 entries$"),
    ],
)
def test_a_text_beyond_a_limit_is_refused_while_it_is_parsed(text, message):
    with pytest.raises(YamlError, match=message):
        load_yaml(text, "a.yaml")
    assert load_yaml("[" * 50 + "]" * 50, "a.yaml")


@pytest.mark.parametrize(
    "text",
    [
        "a: !!int ''", "a: !!float ''", "a: !!bool foo", "a: !!timestamp foo", "a: !!binary é",
        "a: !!python/object:os.system x", "a: !own [1]", "a: !!set {b}", "[[a]]: 1", "{a: 1}: 1",
        "a: 1\na: 2", "a: [1", "*a", "a: \0", "%YAML 1.1\n---\na: 1", "a: 1\n---\nb: 1",
        "<<: 1", "\x1b[31m: [", "a: \ud800", "a: @b", "\t- a", "a: *b",
    ],
)  # fmt: skip
def test_what_cannot_be_converted_is_refused_in_one_printable_line(text):
    with pytest.raises(YamlError, match=r"^limits\.yaml is not YAML: .") as caught:
        load_yaml(text, "limits.yaml")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: x\na: [!!int '']\n", "'' is no int, as its tag says in line 2"),
        ("name: x\na: [!!bool x]\n", "'x' is no bool, as its tag says in line 2"),
        ("a: 1\nb: 2\na: 3\n", "the key 'a' is given twice in line 3"),
        ("a: 1\nb: {c: [1, 2}\n", "in line 2"),
    ],
)
def test_an_error_is_named_with_its_line(text, said):
    with pytest.raises(YamlError, match=said):
        load_yaml(text, "a.yaml")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("[yes, no, on, off, y, N, 1:30, =, _1]",
         ["yes", "no", "on", "off", "y", "N", "1:30", "=", "_1"]),
        ("[true, False, NULL, nUll, ~]", [True, False, None, "nUll", None]),
        ("[0, -0, 12, 017, +1, 0x1f, 0o17, 1_0]", [0, 0, 12, 17, 1, 31, 15, 10]),
        ("[-0.0, 1., .5, 1e3, 1.5E-2, 1.e2]", [-0.0, 1.0, 0.5, 1000.0, 0.015, 100.0]),
        ("[.inf, -.INF, +.Inf, .nan]", [float("inf"), -float("inf"), float("inf"), float("nan")]),
        ("['1', \"true\", !!str 1, !!float 1, !!int 2]", ["1", "true", "1", 1.0, 2]),
        ("[2020-01-02, 1.10 N, /x/y_1]", ["2020-01-02", "1.10 N", "/x/y_1"]),
        ("a: |\n  b\n  c\nd: >\n  e\n  f\n", {"a": "b\nc\n", "d": "e f\n"}),
        ("a: " + "9" * 300, {"a": int("9" * 300)}),
        ("%YAML 1.2\n---\na: 1\n...\n", {"a": 1}),
        ("1: a\nfalse: b", {1: "a", False: "b"}),
    ],
)  # fmt: skip
def test_scalars_have_the_types_of_yaml_1_2(text, value):
    assert repr(load_yaml(text, "a.yaml")) == repr(value)


def test_aliases_refer_to_one_object_and_merge_keys_give_what_a_mapping_lacks():
    text = (
        "base: &b {x: 1, y: [1.5, true, null]}\nother: {<<: *b, x: 2}\nlist: [*b, *b]\n"
        "both: {<<: [{x: 3}, *b], z: 0}\nquoted: {'<<': *b}\n"
    )
    value = load_yaml(text, "a.yaml")
    assert value["other"] == {"x": 2, "y": [1.5, True, None]}
    assert value["list"][0] is value["list"][1] is value["base"]
    assert value["both"] == {"x": 3, "y": [1.5, True, None], "z": 0}
    assert value["quoted"] == {"<<": value["base"]}
    value["base"]["x"] = 7
    assert load_yaml(text, "a.yaml")["base"]["x"] == 1


# Against ruamel.yaml, which reads YAML 1.2 by a parser of its own ---------------------------------

FILES = sorted(ROBOTS.glob("*.yaml"))
SIGNS = (
    *"{}[]:,#|>'\"%@`-?\n.~=<\\", "\n  ", "\n- ", ": ", "- ", "? ", "1", "key", "[1, 2]", "+1",
    " #c", "--- ", "...", "<<: ", "null", "yes", "0o17", "1e3", "012", ".5", "{a: 1}", "1:30", "é",
    "&a ", "*a ",
)  # fmt: skip
LIKELY = ("a: ", "b: ", "- ", "\n", "  ", "1", "x", "[", "]", "{", "}", ", ", "? ", " #", "'q'")


def without_dates(value):
    """The value with dates, which YAML 1.2 does not have, as the texts that they were."""
    if isinstance(value, dict):
        return {key: without_dates(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [without_dates(entry) for entry in value]
    return value.isoformat() if isinstance(value, date) else value


def is_alike(text):
    """Whether both read the text; fails if they then read another value."""
    if re.search(r"(?<![0-9])\.[0-9]+e", text):  # a number by YAML 1.2, not for ruamel.yaml
        return False
    try:
        value = load_yaml(text, "a.yaml")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reference = YAML(typ="safe", pure=True).load(text)
    except (YamlError, YAMLError, AttributeError, TypeError, ValueError, AssertionError):
        return False
    # the text of a value has its types and the order of its keys as well
    assert repr(value) == repr(without_dates(reference)), repr(text)
    return True


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_installed_robot_file_has_one_value(path):
    assert is_alike(path.read_text("utf-8"))


@pytest.mark.parametrize("parts", [SIGNS, LIKELY], ids=["signs", "likely"])
def test_any_sequence_of_signs_has_one_value(parts):
    rng = Random(1)
    texts = ["".join(rng.choice(parts) for _ in range(rng.randrange(1, 12))) for _ in range(5000)]
    assert sum(map(is_alike, texts)) > 150
