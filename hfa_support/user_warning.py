"""Warnings that refer to the line of the user's code."""

from __future__ import annotations

import sys
import warnings


def warn(text: str) -> None:
    """Issue a warning at the nearest caller outside the packages of the project."""
    own = ("hfa", "controller.", "trim.", "verification.")
    level = 1
    while sys._getframe(level).f_globals.get("__name__", "").startswith(own):
        level += 1
    warnings.warn(text, stacklevel=level + 1)
