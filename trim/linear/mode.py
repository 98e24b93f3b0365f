"""Mode of a linear model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hfa_support.errors import no_attribute
from hfa_support.reporting.results import Result


@dataclass(frozen=True)
class Mode(Result):
    """Mode with a real eigenvalue, or a conjugate pair λ = -ζ ω_n ± i ω_n sqrt(1 - ζ²).

    Times are in the model's unit of time, by default s.

    name: name, from the states with the largest participation.
    eigenvalue: λ, 1/s, with imaginary part >= 0; 0 within rounding.
    damping: damping ratio ζ = -Re λ / |λ|, 0 for λ = 0.
    frequency: natural frequency ω_n = |λ|, rad/s.
    period: 2π / Im λ, s, inf for a real eigenvalue.
    time_to_half: -ln 2 / Re λ, s, inf for Re λ >= 0.
    time_to_double: ln 2 / Re λ, s, inf for Re λ <= 0.
    stable: True if Re λ < 0.
    participation: state -> participation; the sum is 1.
    """

    name: str
    eigenvalue: complex
    damping: float
    frequency: float
    period: float
    time_to_half: float
    time_to_double: float
    stable: bool
    participation: dict[str, float]

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Raise AttributeError with the nearest attributes: of mode.zeta, damping."""
            if name[0] == "_":
                raise AttributeError(name)
            raise no_attribute(self, name)
