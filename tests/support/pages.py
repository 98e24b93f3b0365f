"""Code blocks in the documents, and comparison of their printed output."""

from __future__ import annotations

import difflib
import re
from typing import NamedTuple

import numpy as np

_FENCE = re.compile(r"^```(\w*)( slow)?\n(.*?)^```$", re.M | re.S)
#: Groups: a command, its exit code, and its output.
COMMAND = re.compile(r"^\$ ((?:.*\\\n)*.*?)(?:\s+# exit (\d+))?\n((?:(?!\$ ).*\n)*)", re.M)


#: A number below 1e-11, with the blanks before it.
_ROUNDING = re.compile(r" +[-+]?(?:\d(?:\.\d+)?e-(?:1[1-9]|[2-9]\d)|0\.00e\+00)\b")


class Block(NamedTuple):
    """A fenced code block in a document.

    language: language after the fence
    line: number of its first line in the document
    slow: whether it is marked as slow
    """

    language: str
    text: str
    line: int
    slow: bool


def blocks_of(document):
    """Return the fenced blocks of a Markdown document in order."""
    return [
        Block(match[1], match[3], document.count("\n", 0, match.start(3)) + 1, match[2] is not None)
        for match in _FENCE.finditer(document)
    ]


def difference(expected, actual):
    """Return a diff of an expected and an actual output, or "" if they are equal.

    A line "..." in the expected output matches any number of lines. Numbers below 1e-11 are
    rounding, and their digits are not compared.
    """
    expected, actual = (_ROUNDING.sub(" ~0", text) for text in (expected, actual))
    lines = [line.rstrip() for line in expected.strip("\n").splitlines()]
    pattern = "".join(r"(?:.*\n)*?" if line == "..." else re.escape(line) + r"\n" for line in lines)
    output = "".join(f"{line.rstrip()}\n" for line in actual.strip("\n").splitlines())
    if re.fullmatch(pattern, output):
        return ""
    return "\n".join(
        difflib.unified_diff(
            lines, output.splitlines(), "the document", "what happens", lineterm="", n=1
        )
    )


def looks_like(picture, other):
    """Return whether two pictures have equal size and fewer than 0.5 % clearly different pixels.

    The tolerance allows for another date and another rendering of letters.
    """
    from matplotlib.image import imread

    pixels, other_pixels = imread(picture), imread(other)
    if pixels.shape != other_pixels.shape:
        return False
    return bool(np.mean(np.abs(pixels - other_pixels).max(axis=2) > 0.1) < 0.005)
