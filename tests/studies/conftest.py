"""Fixtures of the cases that several studies fly."""

from flown_cases import at_15, newton

__all__ = ["at_15", "newton"]
