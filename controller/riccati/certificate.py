"""Certificate of a game solution: what is proved, and how much K depends on the last digits."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.riccati.balls import Balls, DoubleBalls, precision
from controller.riccati.enclosure import (
    GAIN_CHANGE,
    RAISED,
    Enclosure,
    relative_change,
    relative_radius,
)
from controller.riccati.equation import StepEquation, scaled_balls
from controller.riccati.lyapunov import Lyapunov
from controller.riccati.proposal import FailedError, lyapunov_in_bits
from hfa_support.reporting.results import Result

if TYPE_CHECKING:
    from flint import arb, arb_mat


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
    """Yield what is proved."""
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
    units = enclosure.proved.equation.units.states
    with precision(enclosure.bits):
        L = scaled_balls(enclosure.L, np.zeros(enclosure.L.nrows(), dtype=int), units)
        worst = 0.0
        for row in L.tolist():
            radius, largest = max(entry.rad() for entry in row), max(map(_size, row))
            worst = max(worst, float((radius / largest).upper()) if radius > 0 else 0.0)
    return worst if math.isfinite(worst) else math.inf


def _size(entry: arb) -> arb:
    return abs(entry.mid())


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

    The changes of the entries move P by the solution of a Lyapunov equation. Each entry of A, B
    and E is multiplied by a factor f = 1 ± eps, and the entries ij of Q, N and R by f_i f_j, with
    which the weights remain semidefinite. All is computed in the arithmetic of the proof.
    """
    with np.errstate(all="ignore"):
        try:
            return _gain_change(enclosure)
        except (FailedError, np.linalg.LinAlgError, ValueError, ZeroDivisionError):
            return math.inf


def _gain_change(enclosure: Enclosure) -> float:
    found = enclosure.proved
    equation = found.bounds
    # Bounds are not needed: doubles, or balls for their bits.
    plain: Callable[[Any], Any] = _doubles if equation.arithmetic is DoubleBalls else Balls.of
    n, m, k = equation.n, equation.R.rows, 0
    A, E, Q, X = map(plain, (equation.A, equation.E, equation.Q, found.X))
    gains = plain(found.gains.mid())
    of_bounds = equation.arithmetic.of
    F = plain(equation.loop(of_bounds(found.X), of_bounds(found.gains)))
    if isinstance(equation, StepEquation):
        G, C, W = map(plain, (equation.G, equation.C, equation.W))
        k = len(equation.units.disturbances) if equation.is_disturbed else 0
    else:
        G, C, W = map(plain, (equation.B, equation.N, equation.R))
    signs = np.finfo(float).eps * _signs(n * (n + m + enclosure.game.E.shape[1]))
    of_A, of_B, of_E = np.split(signs, [n * n, n * (n + m)])
    of_states, of_inputs = of_A[:n], np.append(of_B[:m], np.zeros(k))

    def changed(matrix: Any, factors: np.ndarray) -> Any:
        middle = _doubles(matrix)
        return plain(middle * factors.reshape(middle.shape))

    of_G = [of_B.reshape(n, m), of_E.reshape(n, -1)[:, :k]]
    dA, dG = changed(A, of_A), changed(G, np.hstack(of_G))
    dQ = changed(Q, np.add.outer(of_states, of_states))
    dC = changed(C, np.add.outer(of_states, of_inputs))
    of_W = np.add.outer(of_inputs, of_inputs)
    of_W[m:, m:] = 0.0  # the game's delta
    dW = changed(W, of_W)
    pushed = dA - dG @ gains
    if equation.is_disturbed and not equation.is_discrete:
        L = (equation.E.T @ of_bounds(found.X)).times(equation.w)
        pushed = pushed + changed(E, of_E) @ plain(L)
    crossed = dC @ gains
    moved = dQ - crossed - crossed.T + gains.T @ (dW @ gains)
    cross = F.T @ (X @ pushed) if equation.is_discrete else X @ pushed
    moved = moved + cross + cross.T
    Z = plain(_moved_value(F, moved, enclosure.lyapunov, is_discrete=equation.is_discrete))
    right = dC.T - dW @ gains
    if equation.is_discrete:
        right = right + G.T @ (Z @ F + X @ pushed) + dG.T @ (X @ F)
        W = W + G.T @ (X @ G)
    else:
        right = right + G.T @ Z + dG.T @ X
    B, inputs = plain(equation.B), slice(m)
    change_of_K = _rows(plain(_linear_solution(W, right)), inputs)
    K = _rows(gains, inputs)
    return relative_change(_doubles(B @ change_of_K), _doubles(B @ K), _doubles(A))


def _rows(matrix: Balls | np.ndarray, rows: slice) -> Balls | np.ndarray:
    return matrix[rows] if isinstance(matrix, np.ndarray) else matrix.block(rows, slice(None))


def _doubles(matrix: Any) -> np.ndarray:
    """Return the midpoints of a matrix of any kind."""
    return matrix if isinstance(matrix, np.ndarray) else np.asarray(matrix.midpoint)


def _moved_value(
    F: Any, moved: Any, solver: Lyapunov | None, *, is_discrete: bool
) -> np.ndarray | arb_mat:
    """Return Z of F'Z + Z F + moved = 0, (n, n), in discrete time F'Z F - Z + moved = 0."""
    if isinstance(F, Balls):
        return lyapunov_in_bits(F.matrix.mid(), moved.matrix.mid(), is_discrete=is_discrete)
    assert solver is not None  # that of the proposal, which was in doubles as well
    return solver.solve(-moved)[0]


def _linear_solution(matrix: Any, right: Any) -> np.ndarray | arb_mat:
    """Return matrix⁻¹ right: of balls, the midpoints alone."""
    if isinstance(matrix, Balls):
        return matrix.matrix.mid().solve(right.matrix.mid()).mid()
    return np.linalg.solve(matrix, right)


def _signs(count: int) -> np.ndarray:
    """Return the signs of sin(k² + 1), (count,), which have no pattern."""
    k = np.arange(count)
    return np.sign(np.sin(k**2 + 1.0))
