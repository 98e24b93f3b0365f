"""Fixtures of cases that several studies simulate."""

from flown_cases import at_15, newton

__all__ = ["at_15", "newton"]
