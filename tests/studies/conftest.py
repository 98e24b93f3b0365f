"""Fixtures of cases that several studies simulate."""

from simulated_cases import at_15, newton

__all__ = ["at_15", "newton"]
