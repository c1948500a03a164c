"""Text for users: escaping of untrusted text, counts with nouns, and numbers."""

from __future__ import annotations


def printable(text: object) -> str:
    """The text with every control, format or unpaired surrogate character escaped.

    Names, keys and paths may come from untrusted files.  An ANSI escape in one of them must not
    reach a terminal, and a line break must not split a one-line message.
    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def counted(number: int, noun: str) -> str:
    """``1 motor``, ``2 motors``."""
    return f"{number} {noun}" + ("" if number == 1 else "s")


def fixed(value: float, decimals: int) -> str:
    """The number with a fixed number of decimals; zero after rounding has no sign."""
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text
