"""Read YAML that anybody may have written, in bounded time and memory."""

from __future__ import annotations

from typing import Any, Final

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.text import printable

MAXIMUM_CHARACTERS: Final = 1_000_000
"""Of a file; parsing that many takes a few seconds."""
MAXIMUM_NODES: Final = 100_000
"""Scalars, sequences and mappings, a repeated one counted wherever an alias or a merge key repeats
it: a kilobyte of nested aliases can stand for billions."""
MAXIMUM_DEPTH: Final = 50
"""Of nesting, aliases included; what walks through the result may recurse."""
MAXIMUM_DIGITS: Final = 300
"""Of an integer: no double is larger, and Python refuses to print thousands of digits."""

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
"""What the parser raises for tagged values that do not convert, such as `!!int ''`, and for keys
that are no scalars."""


class YamlError(CdrjError):
    """A text that is not YAML, or exceeds a bound of this module."""


def load_yaml(text: str, source: str) -> Any:
    """The value of a YAML text: dicts, lists, strings, numbers, booleans, dates and None.

    Repeated parts (aliases) are the same object.  No value contains itself.

    Args:
        text: one YAML document.
        source: the file's name, for the error.

    Raises:
        YamlError: one line that names the source and the first thing wrong.
    """
    source = printable(source)
    if len(text) > MAXIMUM_CHARACTERS:
        raise YamlError(f"{source} has {len(text)} characters, at most {MAXIMUM_CHARACTERS}")
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = _BoundedComposer
    yaml.Constructor = _BoundedConstructor
    try:
        return yaml.load(text)
    except YamlError as error:
        raise YamlError(f"{source} {error}") from None
    except _INVALID as error:
        reason = " ".join(str(error).split("To suppress")[0].split())
        raise YamlError(
            f"{source} is not YAML: {printable(reason[:300] or type(error).__name__)}"
        ) from None


class _BoundedComposer(Composer):
    """Counts nodes while the text is parsed, so that a large text is refused early."""

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
            raise YamlError(f"is nested more than {MAXIMUM_DEPTH} deep")
        node = super().compose_node(parent, index)
        self._level -= 1
        return node


class _BoundedConstructor(SafeConstructor):
    """Measures the document before anything is made of it: merge keys copy what they merge."""

    def construct_document(self, node: Any) -> Any:
        _extent(node, {})
        return super().construct_document(node)


def _extent(node: Node, known: dict[int, tuple[int, int] | None]) -> tuple[int, int]:
    """Number of nodes and depth of what `node` stands for, every alias followed.

    Nodes are shared between aliases, so each is measured once; an alias comes after its anchor,
    so the recursion is no deeper than the text's own nesting.
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
