"""Fixtures of the Monte Carlo and of the cases that several test files fly."""

from flown_cases import at_15, newton
from member_plans import plan

__all__ = ["at_15", "newton", "plan"]
