"""Certificate of a game solution: what is proved, and how much K depends on the last digits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.riccati.balls import Balls, DoubleBalls, precision
from controller.riccati.enclosure import (
    GAIN_CHANGE,
    RAISED,
    Enclosure,
    relative_change,
    relative_radius,
)
from controller.riccati.equation import Equation, StepEquation, scaled_balls
from controller.riccati.lyapunov import Lyapunov
from controller.riccati.proposal import FailedError, lyapunov_in_bits
from hfa_support.reporting.results import Result

if TYPE_CHECKING:
    from flint import arb_mat


@dataclass(frozen=True, eq=False)
class Certificate(Result):
    """What is proved of a solution, in ball arithmetic, for the exact entries of the game.

    enclosure: balls of the solution
    gain_change: relative change of B K if the entries of the game change in their last digit
    """

    enclosure: Enclosure
    gain_change: float

    @property
    def bits(self) -> int:
        """Number of bits of the proof."""
        return self.enclosure.bits

    @cached_property
    def radius(self) -> float:
        """Largest radius of the balls of P and K, relative to the sizes of their rows."""
        with precision(self.bits):
            return relative_radius(self.enclosure.proved, with_zeros=False)

    @cached_property
    def proved(self) -> tuple[str, ...]:
        """What is proved, in sentences."""
        return tuple(_sentences(self))

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "ok": True,
            "proved": self.proved,
            "radius": self.radius,
            "bits": self.bits,
            "gain_change": self.gain_change,
        }


def certificate_of(enclosure: Enclosure) -> Certificate:
    """Return the certificate of an enclosed solution."""
    with precision(enclosure.bits):
        return Certificate(enclosure, gain_change(enclosure))


def _sentences(certificate: Certificate) -> Iterator[str]:
    """Yield sentences on what is proved: digits, stable loops, price and gain of the disturbance,
    raised weights.
    """
    enclosure = certificate.enclosure
    equation = enclosure.proved.bounds
    game = equation.game
    stable = "stable" if game.is_discrete else "Hurwitz"
    loops: tuple[str, ...] = ("A - B K + E L", "A - B K") if equation.is_disturbed else ("A - B K",)
    if game.discount != 1.0:
        loops = tuple(f"sqrt(discount) ({loop})" for loop in loops)
    yield (
        "P and K are right to the last digit (enclosed with the radius"
        f" {certificate.radius:.1g}, {enclosure.bits} bits)"
    )
    value = "" if enclosure.is_raised else ", and P is positive semidefinite"
    yield f"{' and '.join(loops)} {'are' if len(loops) > 1 else 'is'} {stable}{value}"
    if equation.is_disturbed:
        if game.is_discrete:
            yield "the disturbance pays: delta^2 - E'P E > 0"
        yield f"L is enclosed with the radius {_radius_of_L(enclosure):.1g}"
    if enclosure.is_raised:
        yield (
            "Q, R and N are positive semidefinite up to rounding only: a value, with P positive"
            f" semidefinite, is proved for weights whose diagonals are larger by {RAISED:g}"
        )


def _radius_of_L(enclosure: Enclosure) -> float:
    """Return the largest radius of L, relative to the largest entry of its row in units of the
    proof; inf if no digit of a row is known.
    """
    units = enclosure.proved.bounds.units.states
    with precision(enclosure.bits):
        L = scaled_balls(enclosure.L, np.zeros(enclosure.L.nrows(), dtype=int), units)
        worst = 0.0
        for row in L.tolist():
            radius = max(entry.rad() for entry in row)
            largest = max(abs(entry.mid()) for entry in row)
            worst = max(worst, float((radius / largest).upper()) if radius > 0 else 0.0)
    return worst if math.isfinite(worst) else math.inf


def doubt_about(change: float) -> str:
    """Return that the entries of a game do not determine K, as one sentence, or "".

    change: `gain_change` of the game's solution
    """
    if change <= GAIN_CHANGE:
        return ""
    return (
        f"K changes by {100.0 * change:.2g} % if the entries of the game change in their"
        " last digit: they do not determine K"
    )


def gain_change(enclosure: Enclosure) -> float:
    """Return |B (K2 - K)| / |B K|, to the first order, if all entries change in their last digit.

    A gain whose change is smaller than the last digits of A is not doubted (`relative_change`).

    It is computed in the arithmetic of the proof, and inf if that fails.
    """
    with np.errstate(all="ignore"):
        try:
            return _gain_change(enclosure)
        except (FailedError, np.linalg.LinAlgError, ValueError, ZeroDivisionError):
            return math.inf


class _Changes(NamedTuple):
    """Changes of the matrices of a game, in their last digits.

    A, Q: (n, n)
    G, C, W: of [B E], [N 0] and blkdiag(R, -δ² I), in continuous time of B, N and R
    E: (n, k), 0 columns without a disturbance
    """

    A: Any
    Q: Any
    G: Any
    C: Any
    W: Any
    E: Any


def _gain_change(enclosure: Enclosure) -> float:
    """Return |B dK| / |B K| for the changes `_changes` of the entries.

    Along the loop F of both players, P changes by Z of F'Z + Z F + dc + X df + df'X = 0, with the
    changes df of the loop and dc of the cost for the same gains; in discrete time by Z of
    F'Z F - Z + dc + F'X df + df'X F = 0.
    """
    found = enclosure.proved
    equation = found.bounds
    of_bounds = equation.arithmetic.of
    convert = _to_arithmetic(equation)
    X, gains = convert(found.X), convert(found.gains.mid())
    F = convert(equation.loop(of_bounds(found.X), of_bounds(found.gains)))
    G, _, W = _players(equation)
    G, W = convert(G), convert(W)
    change = _changes(equation)
    df = change.A - change.G @ gains
    if equation.is_disturbed and not equation.is_discrete:
        L = (equation.E.T @ of_bounds(found.X)).times(equation.w)
        df = df + change.E @ convert(L)
    crossed = change.C @ gains
    dc = change.Q - crossed - crossed.T + gains.T @ (change.W @ gains)
    X_df = F.T @ (X @ df) if equation.is_discrete else X @ df
    Z = convert(
        _moved_value(F, dc + X_df + X_df.T, enclosure.lyapunov, is_discrete=equation.is_discrete)
    )
    # The price times the change of the gains, to the first order.
    right = change.C.T - change.W @ gains
    price = W
    if equation.is_discrete:
        right = right + G.T @ (Z @ F + X @ df) + change.G.T @ (X @ F)
        price = W + G.T @ (X @ G)
    else:
        right = right + G.T @ Z + change.G.T @ X
    B, of_input = convert(equation.B), slice(equation.R.rows)
    dK = _rows(convert(_linear_solution(price, right)), of_input)
    K = _rows(gains, of_input)
    return relative_change(_doubles(B @ dK), _doubles(B @ K), _doubles(equation.A))


def _to_arithmetic(equation: Equation[Any]) -> Callable[[Any], Any]:
    """Return the function that converts a matrix for the computation of the changes.

    It returns doubles if the equation is in `DoubleBalls`, else `Balls`, of which only the longer
    midpoints are used.
    """
    return _doubles if equation.arithmetic is DoubleBalls else Balls.of


def _players(equation: Equation[Any]) -> tuple[Any, Any, Any]:
    """Return G, C and W of the gains of an equation: in continuous time B, N and R."""
    if isinstance(equation, StepEquation):
        return equation.G, equation.C, equation.W
    return equation.B, equation.N, equation.R


def _changes(equation: Equation[Any]) -> _Changes:
    """Return the changes of the entries, each ± eps times the entry, with signs without a pattern.

    Each entry of A, B and E has a factor f = ± eps of its own, and the entries ij of Q, N and R
    have f_i + f_j, with which the weights remain semidefinite. δ is not changed.
    """
    convert = _to_arithmetic(equation)
    n, m, k = equation.n, equation.R.rows, equation.game.E.shape[1]
    factors = np.finfo(float).eps * _signs(n * (n + m + k))
    of_A, of_B, of_E = np.split(factors, [n * n, n * (n + m)])
    G, C, W = _players(equation)
    of_columns = [of_B.reshape(n, m)]
    if equation.is_discrete and equation.is_disturbed:
        of_columns.append(of_E.reshape(n, k))
    of_G = np.hstack(of_columns)
    of_states, of_inputs = of_A[:n], np.append(of_B[:m], np.zeros(of_G.shape[1] - m))
    of_W = np.add.outer(of_inputs, of_inputs)
    of_W[m:, m:] = 0.0

    def changed(matrix: Any, factors: np.ndarray) -> Any:
        middle = _doubles(matrix)
        return convert(middle * factors.reshape(middle.shape))

    return _Changes(
        A=changed(equation.A, of_A),
        Q=changed(equation.Q, np.add.outer(of_states, of_states)),
        G=changed(G, of_G),
        C=changed(C, np.add.outer(of_states, of_inputs)),
        W=changed(W, of_W),
        E=changed(equation.E, of_E),
    )


def _rows(matrix: Balls | np.ndarray, rows: slice) -> Balls | np.ndarray:
    """Return some rows of a matrix of either kind."""
    return matrix[rows] if isinstance(matrix, np.ndarray) else matrix.block(rows, slice(None))


def _doubles(matrix: Any) -> np.ndarray:
    """Return the midpoints of a matrix of any kind."""
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.midpoint)


def _moved_value(
    F: Any, C: Any, solver: Lyapunov | None, *, is_discrete: bool
) -> np.ndarray | arb_mat:
    """Return Z of F'Z + Z F + C = 0, (n, n), in discrete time F'Z F - Z + C = 0.

    solver: of the equation in doubles, needed if F is an array
    """
    if isinstance(F, Balls):
        return lyapunov_in_bits(F.matrix.mid(), C.matrix.mid(), is_discrete=is_discrete)
    assert solver is not None  # that of the proposal, which was in doubles as well
    return solver.solve(-C)[0]


def _linear_solution(matrix: Any, right: Any) -> np.ndarray | arb_mat:
    """Return matrix⁻¹ right: of balls, the midpoints alone."""
    if isinstance(matrix, Balls):
        return matrix.matrix.mid().solve(right.matrix.mid()).mid()
    return np.linalg.solve(matrix, right)


def _signs(count: int) -> np.ndarray:
    """Return the signs of sin(k² + 1), k = 0, 1, ..., (count,), which have no pattern."""
    k = np.arange(count)
    return np.sign(np.sin(k**2 + 1.0))
