"""Numbers and polynomials of proofs as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

import numpy as np

from hfa_prove.statements.plant import Plant


def place_in_words(subject: Plant, place: Sequence[float] | np.ndarray) -> str:
    """Return state deviations (n,) as text, each with name and unit."""
    pairs = zip(subject.states, np.asarray(place).tolist(), strict=True)
    return ", ".join(f"{name} {subject.model.describe(name, value)}" for name, value in pairs)


def polynomial_in_words(
    terms: Iterable[tuple[float, Sequence[int]]], variables: Sequence[str]
) -> str:
    """Return the polynomial Σ coefficient variables^exponents as text.

    Each coefficient has six digits.

    terms: pairs of a coefficient and its exponents
    variables: names of the variables
    """
    monomials = []
    for coefficient, exponents in terms:
        powers = zip(variables, exponents, strict=True)
        factors = [f"{name}^{power}" if power > 1 else name for name, power in powers if power]
        monomials.append(" ".join([f"{coefficient:+.6g}", *factors]))
    return " ".join(monomials)


def at_least(value: float, digits: int) -> str:
    """Return a lower bound as text with the given number of digits, rounded down."""
    return _rounded(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int) -> str:
    """Return an upper bound as text with the given number of digits, rounded up."""
    return _rounded(value, digits, ROUND_CEILING)


def _rounded(value: float, digits: int, rounding: str) -> str:
    kept = Context(prec=digits, rounding=rounding).create_decimal(Decimal(float(value)))
    return f"{float(kept):.{digits}g}"
