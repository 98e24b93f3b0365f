"""Base class of proved results about an aircraft at a trim, and their text."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.statements.piece import Piece
from hfa_prove.statements.plant import Plant
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table

#: Note below a table of extents.
NO_BOX = "The set is {V <= rho}, not a box: a state within all of these ranges may lie outside it."


class ProvedResult(Result):
    """A proved result about an aircraft at a trim."""

    @property
    def subject(self) -> Plant:
        """The aircraft about its trim."""
        raise NotImplementedError

    @property
    def proved(self) -> bool:
        """True, because results exist only for proved claims."""
        return True

    @property
    def states(self) -> Sequence[str]:
        """Names of the states that are not held constant, in the order of the deviations z."""
        return self.subject.states

    @property
    def state_units(self) -> Sequence[str]:
        """Unit of each state."""
        return self.subject.model.units(self.states)

    @property
    def trim(self) -> Mapping[str, float]:
        """State or input -> value at the trim."""
        return {**self.subject.trim, **self.subject.inputs, **self.subject.held}

    @property
    def parameters(self) -> Mapping[str, float]:
        """Parameter -> value, for every parameter of the model."""
        return self.subject.parameters

    @property
    def limits(self) -> Mapping[str, Sequence[float]]:
        """Signal -> lowest and highest value, for every signal with a limit."""
        return self.subject.limits


def limits_in_words(subject: Plant, name: str) -> list[str]:
    """Return the lowest and highest value of a signal as text, "-" for a missing limit."""
    ends = subject.limits.get(name, (-np.inf, np.inf))
    model = subject.model
    return [model.describe(name, end) if np.isfinite(end) else "-" for end in ends]


def place_in_words(subject: Plant, place: Sequence[float] | np.ndarray) -> str:
    """Return state deviations (n,) as text, each with name and unit."""
    pairs = zip(subject.states, np.asarray(place).tolist(), strict=True)
    return ", ".join(f"{name} {subject.model.describe(name, value)}" for name, value in pairs)


def outputs_in_words(subject: Plant) -> tuple[str, ...]:
    """Return one line on the limits of outputs in a tuple, or () if no output has limits."""
    listed = []
    for name in subject.model.outputs:
        if name in subject.limits:
            low, high = limits_in_words(subject, name)
            listed.append(f"{name} from {low} to {high}")
    return (f"Limits of outputs: {', '.join(listed)}.",) if listed else ()


def parameters_in_words(model: Model, parameters: Mapping[str, float]) -> str:
    """Return a line with the model's name, the hash of its file and all parameter values."""
    named = ", ".join(f"{name} {model.describe(name, value)}" for name, value in parameters.items())
    file = model.source.digest
    source = f" (SHA-256 of the file: {file[:16]})" if file else ""
    return f"Model: {model.name}{source}. Parameters: {named or 'none'}."


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


def curved_policies_in_words(
    policies: Mapping[str, Iterable[tuple[float, Sequence[int]]]], states: Sequence[str]
) -> tuple[str, ...]:
    """Return one line for each input whose policy is not linear, with the terms of the policy.

    policies: input -> terms of degree 2 and more
    """
    lines = []
    for name, terms in policies.items():
        curved = polynomial_in_words(terms, states)
        lines.append(f"The policy of {name} is -K z {curved}, then saturated.")
    return tuple(lines)


def piece_in_words(piece: Piece, states: Sequence[str]) -> tuple[Table, str]:
    """Return a table of M, and W(y) as text, with y = M z."""
    variables = [f"y{i + 1}" for i in range(len(states))]
    rows = [
        (name, *(f"{entry:.6g}" for entry in row))
        for name, row in zip(variables, piece.M.tolist(), strict=True)
    ]
    W = polynomial_in_words(piece.W.terms, variables)
    return Table(("M", *states), rows), f"W(y) = {W}, y = M z"


def at_least(value: float, digits: int) -> str:
    """Return a lower bound as text with the given number of digits, rounded down."""
    return _rounded(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int) -> str:
    """Return an upper bound as text with the given number of digits, rounded up."""
    return _rounded(value, digits, ROUND_CEILING)


def _rounded(value: float, digits: int, rounding: str) -> str:
    kept = Context(prec=digits, rounding=rounding).create_decimal(Decimal(float(value)))
    return f"{float(kept):.{digits}g}"
