"""Trims of an aircraft on a piece of its scheduling variable, with a proof that they exist.

The trims solve G(w, s) = 0 for the free variables w at the scheduling value s. On a piece
s = s0 + t, |t| <= h, let ŵ(t) = v + v' t be an estimate of the trim, and E a box about 0. If

    K = -Y (G(v, s0) + (G_s + G_w v') t) + (I - Y G_w) E

lies in the interior of E, with G_w and G_s at all points ŵ(t) + E, then for every t exactly one
root is in ŵ(t) + E, this root is in ŵ(t) + K, and it is a smooth function of t (Krawczyk's test).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from flint import arb, arb_mat

from controller.riccati.balls import ball_matrix, identity
from hfa_aircraft.model import Model
from hfa_prove.enclosure.ball_function import READING, BallFunction, Undecided, about_zero, exact
from hfa_prove.fields import Rejected
from hfa_prove.statements.schedule import Flight, unit_of_schedule
from hfa_support.errors import BadInputError

#: Steps of Newton's method for an estimate of a trim, and its largest last step relative to the
#: nominal values.
_NEWTON_STEPS = 20
_LAST_STEP = 1e-9
#: Half-width of the box E relative to the Krawczyk step of a small box.
_BOX_PER_STEP = 4.0
#: Least half-width of E in nominal values.
_LEAST_HALF_WIDTH = 1e-12


class Expressions(NamedTuple):
    """Trim equations and linear model of an aircraft as expressions.

    w: free variables, (f,)
    s: scheduling value, in the unit of the user
    constants: symbols of imposed values, parameters, and the unit of s in the unit of the model
    G: left sides of the trim equations that depend on w, (f,)
    without_w: left sides of the trim equations that do not depend on w
    limited: signals with limits besides imposed values and the scheduling variable
    A, B: matrices of the linear model
    """

    w: ca.SX
    s: ca.SX
    constants: ca.SX
    G: ca.SX
    without_w: ca.SX
    limited: ca.SX
    A: ca.SX
    B: ca.SX


def _limited(flight: Flight) -> tuple[str, ...]:
    """Return the names of the signals whose limits are tested at every trim."""
    # `Flight.check_consistent` tests the limits of given values.
    given = (flight.model.schedule, *flight.imposed)
    return tuple(name for name in flight.limits if name not in given)


@lru_cache(maxsize=8)
def _expressions(
    model: Model, imposed: tuple[str, ...], unknowns: tuple[str, ...], limited: tuple[str, ...]
) -> Expressions:
    """Return the trim equations of steady states and imposed outputs, and the linear model."""
    w = ca.SX.sym("w", len(unknowns))
    s = ca.SX.sym("s")
    constants = ca.SX.sym("constants", len(imposed) + len(model.parameters) + 1)
    # Name -> symbol of every variable and parameter, in the units of the model.
    *known, unit = ca.vertsplit(constants)
    values = dict(zip((*imposed, *model.parameters), known, strict=True))
    values |= dict(zip(unknowns, ca.vertsplit(w), strict=True))
    values[model.schedule] = unit * s

    # The model at these values, with the outputs that are imposed or limited.
    p = ca.vertcat(*(values[name] for name in model.parameters))
    outputs = tuple(name for name in imposed if name not in model.variables)
    used = tuple(dict.fromkeys((*outputs, *(name for name in limited if name in model.outputs))))
    x, u, f, y_used = model.layout.in_variables(values, p, used)
    y = dict(zip(used, ca.vertsplit(y_used) if used else (), strict=True))
    _, _, A, B, *_ = model.functions(())(x, u, p)  # after rates and outputs

    # Left sides of the equations: rates that are 0 at a trim, and deviations of imposed outputs.
    states = list(model.states)
    balanced = [f[states.index(name)] for name in model.steady]
    balanced += [y[name] - values[name] for name in outputs]
    G = ca.densify(ca.vertcat(*balanced))
    depends_on_w = np.array(ca.DM(ca.jacobian_sparsity(G, w), 1)).any(axis=1)

    signals = dict(zip((*states, *model.inputs), ca.vertsplit(ca.vertcat(x, u)), strict=True)) | y
    linear = [states.index(name) for name in model.linear]
    return Expressions(
        w,
        s,
        constants,
        G=G[np.flatnonzero(depends_on_w).tolist()],
        without_w=G[np.flatnonzero(~depends_on_w).tolist()],
        limited=ca.vertcat(*(signals[name] for name in limited)),
        A=A[linear, linear],
        B=B[linear, :],
    )


class TrimEstimate(NamedTuple):
    """Trim at a scheduling value s in doubles, on which no proof depends.

    w: free variables, (f,)
    slope: their derivative in s, (f,)
    inverse: inverse of G_w, (f, f)
    """

    w: np.ndarray
    slope: np.ndarray
    inverse: np.ndarray


@dataclass(frozen=True, eq=False)
class TrimPiece:
    """The trims at all scheduling values from `low` to `high`.

    At s = middle + t, exactly one trim is in estimate + slope t + box, and it is in
    estimate + slope t + offset.

    low, high: ends of the piece
    estimate, slope: (f,), doubles
    box, offset: balls, f each
    """

    low: float
    high: float
    estimate: np.ndarray
    slope: np.ndarray
    box: Sequence[arb]
    offset: Sequence[arb]

    @property
    def middle(self) -> arb:
        """Center of the piece."""
        return (arb(self.low) + arb(self.high)) / 2

    @property
    def half_width(self) -> arb:
        """Half of the length of the piece."""
        return (arb(self.high) - arb(self.low)) / 2

    def at(self, s: float, around: Sequence[arb]) -> list[arb]:
        """Return the enclosures estimate + slope t + around at a scheduling value."""
        t = arb(s) - self.middle
        return self._plus(t, around)

    def along(self, around: Sequence[arb]) -> list[arb]:
        """Return the enclosures estimate + slope t + around for all scheduling values."""
        return self._plus(about_zero(self.half_width), around)

    def _plus(self, t: arb, around: Sequence[arb]) -> list[arb]:
        """Return estimate + slope t + around, f balls."""
        pairs = zip(self.estimate.tolist(), self.slope.tolist(), around, strict=True)
        return [exact(value) + exact(slope) * t + ball for value, slope, ball in pairs]

    def continues(self, before: TrimPiece) -> bool:
        """Return whether the trims of the piece before are proved to be on one branch with these.

        At the common end, the trim of one piece is in the box of the other, which has one trim.
        """
        s = self.low
        return _inside(before.at(s, before.offset), self.at(s, self.box)) or _inside(
            self.at(s, self.offset), before.at(s, before.box)
        )


def _inside(inner: Sequence[arb], outer: Sequence[arb]) -> bool:
    """Return whether each ball is in the interior of the other ball at its place."""
    return all(ball.contains_interior(part) for part, ball in zip(inner, outer, strict=True))


class SteadyFlight:
    """The trim equations of a flight and its linear model, in balls and in doubles.

    flight: aircraft, imposed values and limits

    Raises BadInputError if an operation is not supported in balls, or if the numbers of equations
    and of free variables differ.
    """

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.limited = _limited(flight)
        model = flight.model
        self.expressions = _expressions(model, tuple(flight.imposed), flight.unknowns, self.limited)
        w, s, constants, G, without_w, limited, *_ = self.expressions
        if G.numel() != w.numel():
            raise BadInputError(
                f"a proof requires as many trim equations as free variables, but {G.numel()} "
                f"equations depend on {', '.join(flight.unknowns)}; change --hold and --free"
            )
        given = [w, s, constants]
        slopes = [ca.jacobian(G, w), ca.jacobian(G, s)]
        self._doubles = ca.Function("trim", given, [G, *slopes])
        self._balanced = self.balls("balanced", [G, without_w])
        self._slopes = self.balls("slopes", slopes)
        self._limits = self.balls("limits", [limited])

    def balls(self, name: str, outputs: Sequence[ca.SX], *more: ca.SX) -> BallFunction:
        """Return the function (w, s, constants, *more) -> outputs on balls, column by column."""
        w, s, constants, *_ = self.expressions
        dense = [ca.densify(ca.vec(output)) for output in outputs]
        return BallFunction(
            ca.Function(name, [w, s, constants, *more], dense), self.flight.model.name
        )

    @cached_property
    def nominal(self) -> np.ndarray:
        """Nominal values of the free variables, (f,)."""
        return self.flight.model.nominal(self.flight.unknowns)

    @cached_property
    def doubles(self) -> list[float]:
        """Values of `Expressions.constants`: imposed values, parameters, and the unit of s."""
        flight = self.flight
        return [
            *flight.imposed.values(),
            *flight.parameters.values(),
            float(unit_of_schedule(flight.model).mid()),
        ]

    @cached_property
    def constants(self) -> list[arb]:
        """Balls about `doubles` that contain every decimal that is read as the double.

        The unit of the scheduling variable, π/180 or 1, is not read, and is enclosed exactly.
        """
        *read, _ = self.doubles
        balls = [arb(value, abs(value) * READING) for value in read]
        return [*balls, unit_of_schedule(self.flight.model)]

    def estimate(self, guess: np.ndarray, s: float) -> TrimEstimate:
        """Return the trim at a scheduling value near a guess (f,), by Newton's method.

        Raises Undecided if Newton's method does not converge.
        """
        w = np.array(guess, dtype=float)
        for _ in range(_NEWTON_STEPS):
            G, Gw, Gs = (np.array(matrix) for matrix in self._doubles(w, s, self.doubles))
            try:
                inverse = np.linalg.inv(Gw)
            except np.linalg.LinAlgError as error:
                raise Undecided("the trim equations are singular") from error
            step = (inverse @ G)[:, 0]
            w -= step
            if np.all(np.abs(step) <= 1e-4 * _LAST_STEP * self.nominal):  # rounding errors
                break
        if not np.all(np.abs(step) <= _LAST_STEP * self.nominal):
            raise Undecided("Newton's method for the trim does not converge")
        return TrimEstimate(w, -(inverse @ Gs)[:, 0], inverse)

    def trims(self, low: float, high: float, guess: np.ndarray) -> TrimPiece:
        """Return the proved trims from `low` to `high`, all within their limits.

        guess: estimate of the trim at the center, (f,)

        Raises Undecided or Rejected if the trims are not proved.
        """
        w, slope, Y = self.estimate(guess, 0.5 * (low + high))
        points = [exact(0.0)] * len(w)
        estimated = TrimPiece(low, high, w, slope, box=points, offset=points)
        # The Krawczyk step of a small box about the estimate tells how wide the box must be.
        small_box = [about_zero(_LEAST_HALF_WIDTH * nominal) for nominal in self.nominal]
        first = self._krawczyk(estimated, Y, small_box)
        box = [
            about_zero(_BOX_PER_STEP * abs(ball).upper() + small.rad())
            for ball, small in zip(first, small_box, strict=True)
        ]
        offset = self._krawczyk(estimated, Y, box)
        if not _inside(offset, box):
            raise Rejected("a trim is not proved to exist")
        proved = TrimPiece(low, high, w, slope, box, offset)
        self._check_limits(proved)
        return proved

    def _krawczyk(self, piece: TrimPiece, Y: np.ndarray, box: Sequence[arb]) -> list[arb]:
        """Return the step K = (I - Y G_w) E - Y (G(v, s0) + (G_s + G_w v') t) of a box E.

        piece: piece s0 + t, |t| <= h, with the estimate v + v' t of its trims
        Y: estimate of the inverse of G_w, (f, f)
        """
        f = len(box)
        v = [exact(value) for value in piece.estimate.tolist()]
        G, _ = self._balanced(v, [piece.middle], self.constants)
        s = piece.middle + about_zero(piece.half_width)
        around = piece.along(box)
        if not all(value == 0 for value in self._balanced(around, [s], self.constants)[1]):
            raise Rejected("no values of the free variables satisfy an equation of the trim")
        by_w, by_s = self._slopes(around, [s], self.constants)
        G_w = arb_mat(f, f, by_w).transpose()  # entries are column by column
        along = arb_mat(f, 1, by_s) + G_w * ball_matrix(piece.slope[:, None])
        inverse = ball_matrix(Y)
        newton_step = inverse * (arb_mat(f, 1, G) + along * about_zero(piece.half_width))
        rest = (identity(f) - inverse * G_w) * arb_mat(f, 1, list(box))
        return list((rest - newton_step).entries())

    def _check_limits(self, piece: TrimPiece) -> None:
        """Raise Rejected unless every signal is proved to be within its limits on a piece."""
        s = piece.middle + about_zero(piece.half_width)
        (values,) = self._limits(piece.along(piece.offset), [s], self.constants)
        for name, value in zip(self.limited, values, strict=True):
            low, high = self.flight.limits[name]
            if not (arb(low) <= value and value <= arb(high)):
                raise Rejected(f"{name} is not proved to be within its limits")
