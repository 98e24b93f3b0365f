"""The two ways in which a request can fail; every message is one line that says what to change."""

from __future__ import annotations


class BadInputError(ValueError):
    """What was asked for is not well posed: a wrong name, number, unit, shape or file (exit code 2)."""


class NoSolutionError(RuntimeError):
    """What was asked for is well posed but has no solution, or none that could be certified (exit code 1)."""
