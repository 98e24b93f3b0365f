"""The Monte Carlo that several test files fly."""

from member_plans import plan

__all__ = ["plan"]
