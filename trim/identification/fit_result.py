"""A fit of the parameters to the printed matrices, and what it says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hfa_model.parameters import Parameters, ParameterSet
from hfa_model.reporting.report import Block, Report, Reported
from hfa_model.reporting.text import Table
from hfa_model.support.by_value import ByValue
from hfa_model.vectors import Input

#: Not determined by the print: held, each with its reason.
ASSUMED: dict[str, tuple[float, str, str]] = {
    "chord": (
        8.0,
        "assumed",
        "the printed matrices determine area times coefficient only; Gibson et al. 2011, Table 1, has a chord of 8 ft",
    ),
    "thrust_per_throttle": (
        1.0,
        "assumed",
        "the printed matrices determine forces per mass; counting throttle in lbf of total thrust fixes the mass scale",
    ),
    "gravity": (32.2, "print", "A(speed, pitch) is printed as -32.2"),
}
IDENTIFIED: tuple[str, ...] = tuple(name for name in Parameters._fields if name not in ASSUMED)


@dataclass(frozen=True, eq=False, repr=False)
class Fit(ByValue, Reported):
    """One least-squares fit.

    parameters: with sources and covariance. inputs: fitted trim inputs, one `Input` a printed angle.
    sum_of_squares: Σ (difference / half unit)² over the printed entries; `entries`: how many of them some
    parameter moves. largest: the largest |difference| / half unit.
    expected_sum: the sum of squares that rounding alone gives on average, trace((I - H) C): C the covariance of
    the rounding errors, H the projection onto what the parameters can fit (no prior).
    singular_values: of the weighted Jacobian in relative parameters.
    directions: rows are the parameter combinations that belong to them.
    """

    parameters: ParameterSet
    inputs: tuple[Input, ...]
    sum_of_squares: float
    expected_sum: float
    entries: int
    largest: float
    singular_values: np.ndarray
    directions: np.ndarray

    def report(self) -> Report:
        """How well, which parameters, what the print determines."""
        return Report(
            title=f"Fit to {self.entries} printed entries\n{self.quality()}",
            parts=(self.parameters.table(), self.determination()),
        )

    def quality(self) -> str:
        """The sum of squares and the largest difference."""
        return (
            f"Sum of squares {self.sum_of_squares:.2f} half units² (rounding alone gives "
            f"{self.expected_sum:.1f} on average), largest difference {self.largest:.2f} half units"
        )

    def determination(self) -> Block:
        """Singular values: a combination of relative parameters known to 1/(s sqrt 3)."""
        rows = []
        for value, direction in zip(self.singular_values, self.directions, strict=True):
            largest = np.argsort(-np.abs(direction))[:4]
            combination = "  ".join(f"{direction[i]:+.2f} {IDENTIFIED[i]}" for i in largest if abs(direction[i]) > 0.1)
            rows.append((f"{value:.3g}", f"{100 / (value * np.sqrt(3)):.2g} %", combination))
        return Block(
            (
                Table(("singular value", "known to", "combination of relative parameters"), rows),
                "Not determined by the print, in combination only: all masses, inertias, hinge constants and force "
                "coefficients together\n(fixed by thrust_per_throttle), and chord times the coefficients "
                "(fixed by chord).",
            )
        )
