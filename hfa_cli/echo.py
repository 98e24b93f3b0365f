"""Words of the user as messages repeat them: not at any length, and nothing that a terminal would obey."""

from __future__ import annotations

_LONGEST = 60


def shortened(text: str) -> str:
    """The word, or its beginning."""
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def on_one_line(message: str) -> str:
    """A message without line breaks and control characters: these are spelled, as in "\\x1b"."""
    line = " ".join(message.split())
    return "".join(each if each.isprintable() else ascii(each)[1:-1] for each in line)
