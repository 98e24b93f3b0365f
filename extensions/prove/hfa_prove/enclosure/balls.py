"""Balls of real numbers (python-flint, Arb): a midpoint and a radius that includes all rounding.

A result contains the exact result for all numbers in the arguments. A comparison of balls is true
only if it is true for all of their numbers. Matrices of balls are those of `controller`. Source:
Johansson, Arb: efficient arbitrary-precision midpoint-radius interval arithmetic, IEEE Transactions
on Computers 66 (2017).
"""

from __future__ import annotations

from typing import Any

from flint import arb

import hfa_prove.enclosure.precision  # noqa: F401  # sets the precision of balls

#: Relative radius about a double that contains the decimal from which it was read, also if it was
#: converted from degrees: four units of 2^-53.
READING = 2.0**-51


def exact(value: float) -> arb:
    """Return the ball of radius 0 whose midpoint is a double."""
    return arb(float(value))


def symmetric(radius: Any) -> arb:
    """Return [-r, r], with r an upper bound of the absolute value of a number or ball."""
    bound = abs(arb(radius)).upper()
    return (-bound).union(bound)
