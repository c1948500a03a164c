"""Untrusted YAML gives a value or a one-line error, in bounded time and memory."""

import tracemalloc
from datetime import date

import pytest

from cdrj_ros.foundation.any_yaml import any_yaml
from cdrj_ros.foundation.yaml import YamlError, load_yaml

MOST_MEMORY = 50e6
"""Memory for texts of a few kilobytes [bytes]."""


def nested(last: str, step: str, levels: int = 12) -> str:
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


def test_a_deep_text_that_only_ruamel_reads_is_refused_too():
    with pytest.raises(YamlError, match=r"is nested more than 50 deep$"):
        any_yaml("[" * 51 + "]" * 51)
    assert any_yaml("[" * 50 + "]" * 50)


def test_a_text_of_too_many_entries_is_refused_while_it_is_parsed(monkeypatch):
    monkeypatch.setattr("cdrj_ros.foundation.yaml.MAXIMUM_NODES", 100)
    monkeypatch.setattr("cdrj_ros.foundation.any_yaml.MAXIMUM_NODES", 100)
    assert load_yaml("- 1\n" * 99, "a.yaml") == [1] * 99
    with pytest.raises(YamlError, match="more than 100 entries"):
        load_yaml("- 1\n" * 100 + "[", "a.yaml")


@pytest.mark.parametrize(
    "text",
    [
        "a: !!int ''",
        "a: !!float ''",
        "a: !!bool foo",
        "a: !!timestamp foo",
        "a: !!binary é",
        "a: !!python/object:os.system x",
        "[[a]]: 1",
        "{a: 1}: 1",
        "a: 1\na: 2",
        "a: [1",
        "*a",
        "a: \0",
        "%YAML 1.1\n---\na: 1:" + "59:" * 400 + "1.5",
        "a: 1\n---\nb: 1",
        "\x1b[31m: [",
    ],
)
def test_what_cannot_be_converted_is_refused_in_one_printable_line(text):
    with pytest.raises(YamlError, match=r"^limits\.yaml is not YAML: .") as caught:
        load_yaml(text, "limits.yaml")
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    ("value", "said"), [("!!int ''", "'' in line 2 is no int"), ("!!bool x", "'x' in line 2 is no")]
)
def test_a_value_that_its_tag_contradicts_is_named_with_its_line(value, said):
    with pytest.raises(YamlError, match=said):
        load_yaml(f"name: x\na: [{value}]\n", "a.yaml")


def test_ordinary_yaml_is_read_with_its_aliases_and_merge_keys():
    text = "base: &b {x: 1, y: [1.5, true, null]}\nother: {<<: *b, x: 2}\nlist: [*b, 2020-01-02]\n"
    value = load_yaml(text, "a.yaml")
    assert value["other"] == {"x": 2, "y": [1.5, True, None]}
    assert value["list"] == [{"x": 1, "y": [1.5, True, None]}, date(2020, 1, 2)]


def test_an_empty_text_is_none():
    assert load_yaml("", "a.yaml") is None


def test_a_value_that_was_changed_is_read_again_as_the_text_says() -> None:
    text = "a: &a [1, {b: 2}]\nc: *a\n"
    for _ in range(3):
        value = load_yaml(text, "a.yaml")
        assert value == {"a": [1, {"b": 2}], "c": [1, {"b": 2}]}
        assert value["a"] is value["c"]
        value["a"][1]["b"] = 3
        value["d"] = 4
