"""Read YAML of any kind, with the limits of ``load_yaml``."""

from __future__ import annotations

from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from cdrj_ros.foundation.text import printable
from cdrj_ros.foundation.yaml import (
    MAXIMUM_DEPTH,
    MAXIMUM_DIGITS,
    MAXIMUM_NODES,
    TOO_DEEP,
    YamlError,
)

_INVALID: Final = (
    YAMLError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)
"""Exceptions of the parser for tagged values that do not convert, such as `!!int ''`, and for keys
that are not scalars."""


def any_yaml(text: str) -> Any:
    """The value of a text, plain or not.

    Raises:
        YamlError: the first error; it does not name the source.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = _BoundedComposer
    yaml.Constructor = _BoundedConstructor
    try:
        return yaml.load(text)
    except _INVALID as error:
        reason = " ".join(str(error).split("To suppress")[0].split())
        raise YamlError(f"is not YAML: {printable(reason[:300] or type(error).__name__)}") from None


class _BoundedComposer(Composer):
    """Counts nodes during parsing, so that a large text is refused early."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader=loader)
        self.warn_double_anchors = False
        self._nodes = 0
        self._level = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        self._nodes += 1
        self._level += 1
        if self._nodes > MAXIMUM_NODES:
            raise YamlError(f"has more than {MAXIMUM_NODES} entries")
        if self._level > MAXIMUM_DEPTH:
            raise YamlError(TOO_DEEP)
        node = super().compose_node(parent, index)
        self._level -= 1
        return node


class _BoundedConstructor(SafeConstructor):
    """Checks the expanded size before constructing values, since merge keys copy their content."""

    def construct_document(self, node: Any) -> Any:
        _extent(node, {})
        return super().construct_document(node)

    def construct_object(self, node: Any, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except _INVALID as error:
            if not isinstance(node, ScalarNode) or isinstance(error, YAMLError):
                raise
            kind = str(node.tag).rpartition(":")[2]
            line = node.start_mark.line + 1
            raise YamlError(
                f"is not YAML: {printable(repr(node.value)[:50])} in line {line} is no "
                f"{printable(kind)}, although its tag says so"
            ) from None


def _extent(node: Node, known: dict[int, tuple[int, int] | None]) -> tuple[int, int]:
    """Number of nodes and depth of `node` with all aliases expanded.

    Nodes are shared between aliases, so each is measured once.  An alias follows its anchor, so the
    recursion is no deeper than the nesting of the text.
    """
    if id(node) in known:
        extent = known[id(node)]
        if extent is None:
            raise YamlError("contains an alias of the mapping or list it stands in")
        return extent
    if isinstance(node, ScalarNode):
        if str(node.tag).endswith(":int") and len(node.value) > MAXIMUM_DIGITS:
            raise YamlError(f"holds an integer of {len(node.value)} digits")
        return 1, 1
    known[id(node)] = None
    parts: list[Node] = []
    if isinstance(node, MappingNode):
        parts = [part for pair in node.value for part in pair]
    elif isinstance(node, SequenceNode):
        parts = node.value
    nodes, depth = 1, 1
    for part in parts:
        inner, below = _extent(part, known)
        nodes, depth = nodes + inner, max(depth, below + 1)
    if nodes > MAXIMUM_NODES:
        raise YamlError(f"repeats aliases to more than {MAXIMUM_NODES} entries")
    if depth > MAXIMUM_DEPTH:
        raise YamlError(f"is nested more than {MAXIMUM_DEPTH} deep by aliases")
    known[id(node)] = nodes, depth
    return nodes, depth
