"""Fixtures shared by the tests of flights."""

from flown_cases import at_15, newton
from member_plans import plan

__all__ = ["at_15", "newton", "plan"]
