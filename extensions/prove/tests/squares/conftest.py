"""Fixtures of aircraft whose regions several test files prove."""

from pendulum_regions import model

__all__ = ["model"]
