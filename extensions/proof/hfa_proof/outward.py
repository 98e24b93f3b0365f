"""Text of proved bounds, rounded such that the printed bounds are also proved."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal


def at_least(value: float, digits: int) -> str:
    """Return a lower bound as text with the given number of digits, rounded down."""
    return _rounded(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int) -> str:
    """Return an upper bound as text with the given number of digits, rounded up."""
    return _rounded(value, digits, ROUND_CEILING)


def _rounded(value: float, digits: int, rounding: str) -> str:
    kept = Context(prec=digits, rounding=rounding).create_decimal(Decimal(float(value)))
    return f"{float(kept):.{digits}g}"
