"""Fixtures of cases that several studies simulate."""

from simulated_cases import newton

__all__ = ["newton"]
