"""The equations of a trim in balls and power series, and the boxes in which they have one and only one solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_series

from hfa_model.vectors import INPUTS, STATES
from verification.arithmetic.ball_function import BallFunction, Undecided
from verification.arithmetic.balls import doubles, inside, matrix, symmetric
from verification.enclosures.taylor import dihedral_series, radians
from verification.enclosures.trim_family import EQUATIONS

#: Attempts to widen a box of unknowns until Krawczyk's operator maps it into itself.
_ATTEMPTS = 6


@dataclass(frozen=True, eq=False)
class TrimEquations:
    """F(w, η) = 0: the balanced rates; w: the unknowns `free`, the rest is imposed.

    rates, jacobians: of the model. parameters: balls, or one of them a series.
    """

    rates: BallFunction
    jacobians: BallFunction
    imposed: dict[str, arb]
    free: tuple[str, ...]
    parameters: list[Any]

    def arguments(
        self, dihedral: Any, series: Sequence[Sequence[arb]], length: int
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """States, inputs and parameters; dihedral in rad, the unknowns as coefficients."""
        values: dict[str, Any] = self.imposed | {"dihedral": dihedral}
        for name, own in zip(self.free, series, strict=True):
            values[name] = arb_series(list(own[:length]), prec=length)
        values["pitch"] = values["alpha"] + values["gamma"]
        return [values[name] for name in STATES], [values[name] for name in INPUTS], self.parameters

    def residual(self, dihedral: Any, series: Sequence[Sequence[arb]], length: int) -> list[list[arb]]:
        """Coefficients of F, a list for each equation."""
        rates = self.rates(*self.arguments(dihedral, series, length))[0]
        return [coefficients(rates[index], length) for index in EQUATIONS]

    def derivative(self, degrees: arb, values: list[arb]) -> arb_mat:
        """F_w at constant arguments."""
        _, A, B = self.jacobians(*self.arguments(radians(degrees), [[value] for value in values], 1))
        n, flat = len(STATES), [coefficients(each, 1)[0] for each in [*A, *B]]
        columns = {name: flat[n * j : n * j + n] for j, name in enumerate(STATES + INPUTS)}
        # The pitch angle is no variable of a trim: it is alpha + gamma.
        columns["alpha"] = [a + b for a, b in zip(columns["alpha"], columns["pitch"], strict=True)]
        columns["gamma"] = columns["pitch"]
        return arb_mat([[columns[name][row] for name in self.free] for row in EQUATIONS])

    def inverse(self, degrees: arb, values: list[arb]) -> arb_mat:
        """A matrix of balls that holds the inverse of F_w."""
        derivative = self.derivative(degrees, values)
        rough = matrix(np.linalg.inv(doubles(derivative)))
        try:
            return (rough * derivative).inv() * rough
        except ZeroDivisionError as error:
            raise Undecided("the derivative of the trim equations may be singular on this box") from error

    def newton(self, degrees: arb, values: list[arb]) -> tuple[list[arb], arb_mat]:
        """C F(w, η) and C, the inverse of F_w rounded to doubles."""
        inverse = matrix(np.linalg.inv(doubles(self.derivative(degrees.mid(), values))))
        residual = self.residual(radians(degrees), [[value] for value in values], 1)
        return (inverse * arb_mat([[series[0]] for series in residual])).entries(), inverse

    def contracted(self, degrees: arb, middle: list[arb], widths: list[arb]) -> list[arb]:
        """Balls about `middle` that Krawczyk's operator maps into their interior, as it leaves them."""
        step, inverse = self.newton(degrees, middle)
        identity = matrix(np.eye(len(middle)))
        for _ in range(_ATTEMPTS):
            offsets = [symmetric(1.2 * width) for width in widths]
            candidate = [value + offset for value, offset in zip(middle, offsets, strict=True)]
            jacobian = self.derivative(degrees, candidate)
            image = (identity - inverse * jacobian) * arb_mat([[offset] for offset in offsets])
            mapped = [row - change for change, row in zip(step, image.entries(), strict=True)]
            if inside(mapped, offsets):
                return [value + offset for value, offset in zip(middle, mapped, strict=True)]
            widths = [abs(before.union(after)).upper() for before, after in zip(offsets, mapped, strict=True)]
        raise Undecided("Krawczyk's operator does not map a box of unknowns into itself")

    def branch(self, degrees: arb, start: list[arb], length: int) -> list[list[arb]]:
        """Taylor coefficients w_0 .. in the dihedral, degrees, of the branch through `start`; a list an unknown."""
        series, solved = [[value] for value in start], self.inverse(degrees, start)
        for j in range(1, length):
            residual = self.residual(dihedral_series(degrees, j + 1), series, j + 1)
            change = solved * arb_mat([[each[j]] for each in residual])
            for own, value in zip(series, change.entries(), strict=True):
                own.append(-value)
        return series


def coefficients(value: Any, length: int) -> list[arb]:
    """Of a series or a ball, `length` of them."""
    if isinstance(value, arb):
        return [value] + [arb(0)] * (length - 1)
    return [value[index] for index in range(length)]
