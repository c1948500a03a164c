"""Text that was read from somewhere, made safe to print."""

from __future__ import annotations


def printable(text: object) -> str:
    """The text with every control, format or unpaired surrogate character escaped.

    Names, keys and paths come from files that anybody may have written.  An ANSI escape in one of
    them must not reach a terminal, nor a line break split a one-line message.
    """
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in str(text)
    )
