"""The branch of trims over a box of dihedrals, and the linear model along it, enclosed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.aircraft import Aircraft, compiled_dynamics
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from trim.point.condition import LIMITS, TrimCondition, level_flight
from trim.point.solve import find_operating_point
from verification.proof.ball_function import BallFunction, Undecided
from verification.proof.balls import as_read, doubles, exact, flint_or_refusal, inside, matrix, symmetric
from verification.proof.taylor import ORDER, DihedralBox, TaylorForm, dihedral_series

if TYPE_CHECKING:
    from flint import arb, arb_mat

_ROWS = [STATES.index(name) for name in LINEAR_STATES]
#: Attempts to widen a box of inputs until Krawczyk's operator maps it into itself.
_ATTEMPTS = 6
#: Least half width of such a box: what is known exactly still needs an interior.
_TINY = 1e-30


@dataclass(frozen=True)
class Family:
    """Level, climbing or gliding flights that differ in their dihedral alone, with what `level_flight` leaves free.

    aircraft: its parameters as doubles. settings: speed (ft/s), altitude (ft), alpha and gamma (rad) as `level_flight`
    takes them. spread: a half width for each parameter, (18,). decimals: every parameter and setting is a ball that
    also holds the decimal it was read from; else it is the double exactly.
    """

    aircraft: Aircraft
    settings: dict[str, Any]
    spread: tuple[float, ...] | None = None
    decimals: bool = True

    def condition(self, degrees: float) -> TrimCondition:
        """The trim at a dihedral, degrees."""
        return level_flight(math.radians(degrees), **self.settings)


@dataclass(frozen=True)
class ModelForms:
    """Over a box: inputs U0(η), (5, 1), and A(η), (6, 6), B(η), (6, 5), of the six states of the linear model.

    next_inputs: the third Taylor coefficient of each input at the middle, how large the remainder about is.
    """

    box: DihedralBox
    inputs: TaylorForm
    next_inputs: list[arb]
    A: TaylorForm
    B: TaylorForm


class TrimBranch:
    """Encloses trims and linear models of a family of flights.

    F(w, η) = 0 are the balanced rates, w the free inputs. On a box, Krawczyk's operator
    K(W) = ŵ - C F(ŵ, η) + (I - C F_w(W, η)) (W - ŵ) maps W into its own interior: for every η of the box there is
    one and only one w(η) in W (Krawczyk 1969; Moore 1977), and it is smooth. Its Taylor coefficients follow one
    after the other from F_w w_j = -[F(Σ_{i<j} w_i τ^i, η + τ)]_j.
    """

    def __init__(self, family: Family) -> None:
        flint_or_refusal()
        self.family = family
        condition = family.condition(0.0)
        self.free = tuple(INPUTS.index(name) for name in condition.free)
        ball = as_read if family.decimals else exact
        self._imposed = {name: ball(value) for name, value in condition.imposed.items()}
        self._imposed["pitch"] = self._imposed["alpha"] + self._imposed["gamma"]
        values = family.aircraft.parameters
        spread = family.spread or (0.0,) * len(values)
        self._parameters = [ball(value) + symmetric(width) for value, width in zip(values, spread, strict=True)]
        functions = compiled_dynamics(family.aircraft.variant)
        self._rates, self._jacobians = BallFunction(functions.rates), BallFunction(functions.jacobians)
        # At a level flight θ' = q and η' = η' are 0 already; what the free inputs move is left.
        self._equations = [STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")]

    def forms(self, box: DihedralBox) -> ModelForms:
        """The model over a box. Undecided when the box is too wide, TrimError when its middle has no trim."""
        middle = find_operating_point(self.family.aircraft, self.family.condition(float(box.middle)))
        point = self._point(box.middle, [exact(middle.inputs[index]) for index in self.free])
        at_middle = self._coefficients(box.middle, point, ORDER + 1)
        over_box = self._coefficients(box.degrees, self._everywhere(box, at_middle), ORDER + 1)
        return self._composed(box, at_middle, over_box)

    def model_at(self, degrees: float) -> tuple[arb_mat, arb_mat, arb_mat]:
        """A (6, 6), B (6, 5) and the inputs (5, 1) at one dihedral, degrees, in balls."""
        from flint import arb_mat

        guess = find_operating_point(self.family.aircraft, self.family.condition(degrees))
        point = self._point(exact(degrees), [exact(guess.inputs[index]) for index in self.free])
        state, control = self._vectors([exact(degrees)], [[value] for value in point], 1)
        _, A, B = self._jacobians(state, control, self._parameters)
        n = len(STATES)
        return (
            arb_mat([[_series(A[n * j + i], 1)[0] for j in _ROWS] for i in _ROWS]),
            arb_mat([[_series(B[n * j + i], 1)[0] for j in range(len(INPUTS))] for i in _ROWS]),
            arb_mat([[_series(value, 1)[0]] for value in control]),
        )

    def input_beyond_limits(self, forms: ModelForms) -> str | None:
        """An input that may leave its limits somewhere on the box; None when every one is proved to stay within."""
        for name, row in zip(INPUTS, forms.inputs.range().tolist(), strict=True):
            low, high = LIMITS[name]
            if not (exact(low) <= row[0] <= exact(high)):
                return name
        return None

    def _point(self, degrees: arb, middle: list[arb]) -> list[arb]:
        """The trim at one angle: Newton's method on midpoints, then Krawczyk."""
        for _ in range(2):
            step, _ = self._newton(degrees, middle)
            middle = [(value - change).mid() for value, change in zip(middle, step, strict=True)]
        step, _ = self._newton(degrees, middle)
        return self._contracted(degrees, middle, [abs(change).upper() + exact(_TINY) for change in step])

    def _everywhere(self, box: DihedralBox, at_middle: list[list[arb]]) -> list[arb]:
        """A ball for each input that holds the branch on the whole box: w(η) = w(η_0) + w'(ξ) (η - η_0)."""
        start = [series[0] for series in at_middle]
        widths = [series[0].rad() + abs(series[1]).upper() * box.radius + exact(_TINY) for series in at_middle]
        found = self._contracted(box.degrees, [value.mid() for value in start], widths)
        if not all(ball.contains(value) for ball, value in zip(found, start, strict=True)):
            raise Undecided("the trim at the middle of the box is not the one found around it")
        slopes = self._coefficients(box.degrees, found, 2)
        tau = symmetric(box.radius)
        return [value + tau * series[1] for value, series in zip(start, slopes, strict=True)]

    def _contracted(self, degrees: arb, middle: list[arb], widths: list[arb]) -> list[arb]:
        """Balls about `middle` that Krawczyk's operator maps into their interior, as it leaves them."""
        from flint import arb_mat

        step, inverse = self._newton(degrees, middle)
        identity = matrix(np.eye(len(middle)))
        for _ in range(_ATTEMPTS):
            offsets = [symmetric(1.2 * width) for width in widths]
            candidate = [value + offset for value, offset in zip(middle, offsets, strict=True)]
            jacobian = self._derivative(degrees, candidate)
            image = (identity - inverse * jacobian) * arb_mat([[offset] for offset in offsets])
            mapped = [row[0] - change for change, row in zip(step, image.tolist(), strict=True)]
            if inside(mapped, offsets):
                return [value + offset for value, offset in zip(middle, mapped, strict=True)]
            widths = [abs(before.union(after)).upper() for before, after in zip(offsets, mapped, strict=True)]
        raise Undecided("Krawczyk's operator does not map a box of inputs into itself")

    def _newton(self, degrees: arb, values: list[arb]) -> tuple[list[arb], arb_mat]:
        """C F(w, η) and C, the inverse of F_w rounded to doubles."""
        from flint import arb_mat

        inverse = matrix(np.linalg.inv(doubles(self._derivative(degrees.mid(), values))))
        residual = self._residual([degrees], [[value] for value in values], 1)
        step = inverse * arb_mat([[series[0]] for series in residual])
        return [row[0] for row in step.tolist()], inverse

    def _coefficients(self, degrees: arb, start: list[arb], length: int) -> list[list[arb]]:
        """Taylor coefficients w_0 .. of the branch through `start`, one list an input."""
        from flint import arb_mat

        series = [[value] for value in start]
        derivative = self._derivative(degrees, start)
        rough = matrix(np.linalg.inv(doubles(derivative)))
        try:
            solved = (rough * derivative).inv() * rough
        except ZeroDivisionError as error:
            raise Undecided("the derivative of the trim equations may be singular on this box") from error
        for j in range(1, length):
            residual = self._residual([degrees, exact(1.0)], series, j + 1)
            change = solved * arb_mat([[each[j]] for each in residual])
            for own, row in zip(series, change.tolist(), strict=True):
                own.append(-row[0])
        return series

    def _residual(self, angle: list[arb], series: list[list[arb]], length: int) -> list[Any]:
        state, control = self._vectors(angle, series, length)
        rates = self._rates(state, control, self._parameters)[0]
        return [_series(rates[index], length) for index in self._equations]

    def _derivative(self, degrees: arb, values: list[arb]) -> arb_mat:
        """F_w at constant arguments."""
        from flint import arb_mat

        state, control = self._vectors([degrees], [[value] for value in values], 1)
        flat = self._jacobians(state, control, self._parameters)[2]
        columns = [flat[len(STATES) * index : len(STATES) * (index + 1)] for index in self.free]
        return arb_mat([[_series(column[row], 1)[0] for column in columns] for row in self._equations])

    def _vectors(self, angle: list[arb], series: list[list[arb]], length: int) -> tuple[list[Any], list[Any]]:
        from flint import arb_series

        values: dict[str, Any] = dict(self._imposed)
        values["dihedral"] = dihedral_series(angle[0], length)
        for index, own in zip(self.free, series, strict=True):
            values[INPUTS[index]] = arb_series(own[:length], prec=length)
        return [values[name] for name in STATES], [values[name] for name in INPUTS]

    def _composed(self, box: DihedralBox, middle: list[list[arb]], wide: list[list[arb]]) -> ModelForms:
        from flint import arb

        parts = []
        for degrees, series, length in ((box.middle, middle, ORDER), (box.degrees, wide, ORDER + 1)):
            state, control = self._vectors([degrees], series, length)
            _, A, B = self._jacobians(state, control, self._parameters)
            parts.append((control, A, B))
        third = [arb(0)] * len(INPUTS)
        for index, own in zip(self.free, middle, strict=True):
            third[index] = own[ORDER]
        (u, A, B), (wide_u, wide_A, wide_B) = parts
        inputs = list(range(len(INPUTS)))
        return ModelForms(
            box,
            _form(box, u, wide_u, inputs, [0], len(INPUTS)),
            third,
            _form(box, A, wide_A, _ROWS, _ROWS, len(STATES)),
            _form(box, B, wide_B, _ROWS, inputs, len(STATES)),
        )


def _series(value: Any, length: int) -> Any:
    """The coefficients of a series or a ball, `length` of them."""
    from flint import arb

    if isinstance(value, arb):
        return [value] + [arb(0)] * (length - 1)
    return [value[index] for index in range(length)]


def _form(
    box: DihedralBox, thin: list[Any], wide: list[Any], rows: list[int], columns: list[int], height: int
) -> TaylorForm:
    """The Taylor form of a matrix that CasADi stores column by column, `height` rows each."""
    from flint import arb_mat

    def coefficient(entries: list[Any], order: int) -> arb_mat:
        return arb_mat([[_series(entries[height * j + i], order + 1)[order] for j in columns] for i in rows])

    return TaylorForm(tuple(coefficient(thin, j) for j in range(ORDER)), coefficient(wide, ORDER), box.radius)
