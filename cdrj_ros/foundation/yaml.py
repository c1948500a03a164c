"""Read untrusted YAML in bounded time and memory.

The syntax is that of libyaml, the types of scalars are those of YAML 1.2 (core schema): ``yes`` is
a text, ``1e3`` a number, and so is ``1_000``.  Aliases and merge keys are followed, up to the
limits below.
"""

from __future__ import annotations

import re
from typing import Any, ClassVar, Final

import yaml
from yaml.constructor import ConstructorError

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.output import printable

MAXIMUM_CHARACTERS: Final = 1_000_000
"""Maximum length of a text."""
MAXIMUM_NODES: Final = 100_000
"""Maximum number of scalars, sequences and mappings after expansion of aliases and merge keys: a
kilobyte of nested aliases can expand to billions."""
MAXIMUM_DEPTH: Final = 50
"""Maximum depth of nesting, including aliases, since users of the result may recurse."""
MAXIMUM_DIGITS: Final = 300
"""Maximum length of an integer, close to the largest double; Python does not print thousands of
digits."""

_BASE: Final[Any] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""In C, or in Python where PyYAML was built without libyaml."""

_TAG: Final = "tag:yaml.org,2002:"
_MERGE: Final = f"{_TAG}merge"
_DIGITS: Final = "[0-9](?:_?[0-9])*"
_FORMS: Final = {
    "null": r"|~|null|Null|NULL",
    "bool": r"true|True|TRUE|false|False|FALSE",
    "int": rf"[-+]?{_DIGITS}|0o[0-7]+|0x[0-9a-fA-F]+",
    "float": rf"[-+]?(?:\.{_DIGITS}|{_DIGITS}(?:\.(?:{_DIGITS})?)?)(?:[eE][-+]?[0-9]+)?"
    r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)",
    "merge": "<<",
}
"""What a scalar without quotes is, by the core schema of YAML 1.2; the first form counts."""


Document = dict[str, Any]
"""A mapping of plain containers: the content of a robot file, or of an entry in it."""


class YamlError(CdrjError):
    """A text that is not valid YAML or exceeds a limit of this module."""


def load_yaml(text: str, source: str) -> Any:
    """The value of a YAML text: dicts, lists, strings, numbers, booleans and None.

    Aliases refer to the same object.  No value contains itself.

    Args:
        text: one YAML document.
        source: the file's name, for the error.

    Raises:
        YamlError: one line that names the source and the first error.
    """
    try:
        if len(text) > MAXIMUM_CHARACTERS:
            raise YamlError(f"has {len(text)} characters, at most {MAXIMUM_CHARACTERS}")
        try:
            _check_size(text)
            return _loaded(text)
        except yaml.MarkedYAMLError as error:
            where = f" in line {error.problem_mark.line + 1}" if error.problem_mark else ""
            raise YamlError(f"is not YAML: {error.problem}{where}") from None
        except (yaml.YAMLError, ValueError) as error:  # characters that YAML does not allow
            raise YamlError(f"is not YAML: {' '.join(str(error).split())[:300]}") from None
    except YamlError as error:
        raise YamlError(f"{printable(source)} {error}") from None


def yaml_text(document: Any, *, block: bool = False) -> str:
    """A document of mappings, lists, texts and numbers as YAML.

    Args:
        document: what is written.
        block: whether every entry has a line of its own; otherwise short lists share one.
    """
    style = {"default_flow_style": False, "width": 4096} if block else {"default_flow_style": None}
    text: str = yaml.safe_dump(document, sort_keys=False, allow_unicode=True, **style)
    return text


def yaml_flow(value: Any) -> str:
    """A value of mappings, lists, texts and numbers as YAML in one line."""
    text: str = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=float("inf")
    )
    return text.removesuffix("...\n").rstrip()


def yaml_nodes(text: str) -> Any:
    """The nodes of a text that ``load_yaml`` accepts, with their places in it.

    They have ``id`` (``scalar``, ``sequence``, ``mapping``), ``value``, ``start_mark`` and
    ``end_mark``; marks have ``index`` and ``column``.
    """
    return yaml.compose(text, Loader=_Loader)


def first_alias(text: str) -> int | None:
    """Number of the line of the first alias or merge key of a text; None without one."""
    for event in yaml.parse(text, Loader=_BASE):
        if isinstance(event, yaml.AliasEvent):
            return int(event.start_mark.line) + 1
    return None


class _Loader(_BASE):  # type: ignore[misc]
    """PyYAML's loader of plain containers with the types of YAML 1.2 and no other tags."""

    yaml_implicit_resolvers: ClassVar[dict[Any, Any]] = {}
    yaml_constructors: ClassVar[dict[Any, Any]] = {}

    def scalar(self, node: Any) -> Any:
        """Value of a number, a truth or nothing, whose form its tag confirms."""
        text, kind = node.value, node.tag.removeprefix(_TAG)
        form = next((name for name, one in _FORMS.items() if re.fullmatch(one, text)), "")
        if form != kind and (kind, form) != ("float", "int"):
            said = f"{text[:50]!r} is no {kind}, as its tag says"
            raise ConstructorError(problem=said, problem_mark=node.start_mark)
        if kind in ("null", "bool"):
            return text.lower() == "true" if kind == "bool" else None
        if form == "float":
            return float(text.replace(".", "") if text[-1].isalpha() else text)
        if len(text) > MAXIMUM_DIGITS:
            raise YamlError(f"holds an integer of {len(text)} digits")
        value = int(text, 0 if text[:2] in ("0o", "0x") else 10)
        return float(value) if kind == "float" else value


for _name, _form in _FORMS.items():
    _Loader.add_implicit_resolver(_TAG + _name, re.compile(f"(?:{_form})$"), None)
    _Loader.add_constructor(_TAG + _name, _Loader.scalar)
for _tag, _construct in (
    ("str", _BASE.construct_yaml_str), ("seq", _BASE.construct_yaml_seq),
    ("map", _BASE.construct_yaml_map), ("merge", _BASE.construct_yaml_str),
):  # fmt: skip
    _Loader.add_constructor(_TAG + _tag, _construct)
_Loader.add_constructor(None, _BASE.construct_undefined)


def _check_size(text: str) -> None:
    """Refuse what is too long, too deep or another version, before anything recurses."""
    count = depth = 0
    for event in yaml.parse(text, Loader=_BASE):
        if isinstance(event, yaml.DocumentStartEvent) and event.version not in (None, (1, 2)):
            raise YamlError("is not YAML: a %YAML directive must be 1.2")
        count += isinstance(event, yaml.NodeEvent)
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if count > MAXIMUM_NODES:
            raise YamlError(f"has more than {MAXIMUM_NODES} entries")
        if depth > MAXIMUM_DEPTH:
            raise YamlError(f"is nested more than {MAXIMUM_DEPTH} deep")


def _loaded(text: str) -> Any:
    loader = _Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _measure(loader, node, {})
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _measure(loader: Any, node: Any, known: dict[int, tuple[int, int] | None]) -> tuple[int, int]:
    """Number of entries and depth of a node with its aliases expanded, which have limits.

    A node that contains itself, or a mapping with a key that repeats or is no scalar, is refused.
    """
    if id(node) in known:
        if (found := known[id(node)]) is None:
            raise YamlError("contains an alias of the mapping or list it stands in")
        return found
    known[id(node)] = None  # until it ends
    inside = node.value if isinstance(node, yaml.SequenceNode) else []
    if isinstance(node, yaml.MappingNode):
        keys = set()
        for key, entry in node.value:
            if not isinstance(key, yaml.ScalarNode):
                problem = "a key must be a scalar"
                raise ConstructorError(problem=problem, problem_mark=key.start_mark)
            value = loader.construct_object(key)
            if value in keys and key.tag != _MERGE:
                problem = f"the key {value!r:.50} is given twice"
                raise ConstructorError(problem=problem, problem_mark=key.start_mark)
            keys.add(value)
            inside += [key, entry]
    parts = [_measure(loader, one, known) for one in inside]
    count = 1 + sum(n for n, _ in parts)
    depth = max((d for _, d in parts), default=0) + isinstance(node, yaml.CollectionNode)
    if count > MAXIMUM_NODES:
        raise YamlError(f"repeats aliases to more than {MAXIMUM_NODES} entries")
    if depth > MAXIMUM_DEPTH:
        raise YamlError(f"is nested more than {MAXIMUM_DEPTH} deep by aliases")
    known[id(node)] = count, depth
    return count, depth
