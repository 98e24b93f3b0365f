"""Words of the user, and values of the user's files, as messages repeat them: not at any length, and nothing that a
terminal would obey."""

from __future__ import annotations

from typing import Any

_LONGEST = 60
_LONGEST_LINE = 1000


def shortened(text: str, longest: int = _LONGEST) -> str:
    """The word, or its beginning."""
    return text if len(text) <= longest else f"{text[:longest]}..."


def shown(value: Any) -> str:
    """A value as Python writes it, or the beginning of that."""
    try:
        return shortened(repr(value))
    except ValueError:  # Python does not write whole numbers of more than 4300 digits
        return "a number of thousands of digits"


def on_one_line(message: str) -> str:
    """A message without line breaks and control characters, which are spelled, as in "\\x1b"; or its beginning."""
    line = " ".join(message[: 4 * _LONGEST_LINE].split())
    return shortened("".join(each if each.isprintable() else ascii(each)[1:-1] for each in line), _LONGEST_LINE)
