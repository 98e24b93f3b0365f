"""Bounds as text, rounded so that the printed bounds are proved too."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal


def at_least(value: float, digits: int) -> str:
    """A lower bound with so many digits, rounded down."""
    return _rounded(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int) -> str:
    """An upper bound with so many digits, rounded up."""
    return _rounded(value, digits, ROUND_CEILING)


def _rounded(value: float, digits: int, rounding: str) -> str:
    kept = Context(prec=digits, rounding=rounding).create_decimal(Decimal(float(value)))
    return f"{float(kept):.{digits}g}"
