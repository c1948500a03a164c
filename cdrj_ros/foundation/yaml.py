"""Read untrusted YAML in bounded time and memory."""

from __future__ import annotations

from copy import deepcopy
from functools import lru_cache
from typing import Any, Final

from cdrj_ros.foundation.errors import CdrjError
from cdrj_ros.foundation.plain_yaml import NotPlainError, TooDeepError, plain_yaml
from cdrj_ros.foundation.text import printable

MAXIMUM_CHARACTERS: Final = 1_000_000
"""Maximum length of a text; parsing one of this length takes a few seconds."""
MAXIMUM_NODES: Final = 100_000
"""Maximum number of scalars, sequences and mappings after expansion of aliases and merge keys: a
kilobyte of nested aliases can expand to billions."""
MAXIMUM_DEPTH: Final = 50
"""Maximum depth of nesting, including aliases, since users of the result may recurse."""
TOO_DEEP: Final = f"is nested more than {MAXIMUM_DEPTH} deep"
REMEMBERED: Final = 16
"""Texts whose values are remembered: a command reads a robot file more than once, and parsing takes
six times as long as copying the value, if the text is not plain two hundred times."""
MAXIMUM_DIGITS: Final = 300
"""Maximum length of an integer, close to the largest double; Python does not print thousands of
digits."""


class YamlError(CdrjError):
    """A text that is not valid YAML or exceeds a limit of this module."""


def load_yaml(text: str, source: str) -> Any:
    """The value of a YAML text: dicts, lists, strings, numbers, booleans, dates and None.

    Aliases refer to the same object.  No value contains itself.

    Args:
        text: one YAML document.
        source: the file's name, for the error.

    Raises:
        YamlError: one line that names the source and the first error.
    """
    source = printable(source)
    if len(text) > MAXIMUM_CHARACTERS:
        raise YamlError(f"{source} has {len(text)} characters, at most {MAXIMUM_CHARACTERS}")
    try:
        return deepcopy(_parsed(text))
    except YamlError as error:
        raise YamlError(f"{source} {error}") from None


@lru_cache(maxsize=REMEMBERED)
def _parsed(text: str) -> Any:
    """The value of a text, which must not be changed; errors do not name the source."""
    try:
        return plain_yaml(text, MAXIMUM_NODES, MAXIMUM_DEPTH)
    except TooDeepError:
        raise YamlError(TOO_DEEP) from None
    except NotPlainError:
        from cdrj_ros.foundation.any_yaml import any_yaml  # takes 15 ms, and is rarely needed

        return any_yaml(text)
