"""Certificate of a game solution: what is proved, and how much K depends on the last digits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from controller.game.zero_sum import SYMMETRIC, Game, least_scaled_eigenvalue
from controller.riccati.balls import Balls, ball_matrix, midpoints, precision
from controller.riccati.candidate import sizes_of
from controller.riccati.enclosure import Enclosure
from controller.riccati.lyapunov import FailedError, lyapunov_in_bits, lyapunov_of
from controller.riccati.refusal import has_semidefinite_weights
from hfa_support.reporting.results import Result

#: Largest relative change of P and K that their data determine: two digits are known.
DETERMINED = 0.01


@dataclass(frozen=True, eq=False)
class Certificate(Result):
    """What is proved of a solution, in ball arithmetic, for the exact entries of the game.

    enclosure: balls of the solution
    data_change: largest relative change of P, to the first order, where each entry of the game
        changes in its last digit
    """

    enclosure: Enclosure
    data_change: float

    @property
    def bits(self) -> int:
        """Number of bits of the proof."""
        return self.enclosure.bits

    @cached_property
    def radius(self) -> float:
        """Largest radius of the balls of P and K, relative to the sizes of their rows."""
        return self.enclosure.relative_radius(with_zeros=False)

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
            "data_change": self.data_change,
        }


def certificate_of(enclosure: Enclosure) -> Certificate:
    """Return the certificate of an enclosed solution."""
    return Certificate(enclosure, data_change(enclosure))


def has_indefinite_weights(game: Game) -> bool:
    """Return whether [[Q, N], [N', R]] is indefinite beyond rounding."""
    return not has_semidefinite_weights(game) and least_scaled_eigenvalue(game.weights) < -SYMMETRIC


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
    is_value = has_semidefinite_weights(game)
    is_positive = is_value or enclosure.proved.P.is_positive_definite()
    value = ", and P is positive semidefinite" if is_positive else ""
    yield f"{' and '.join(loops)} {'are' if len(loops) > 1 else 'is'} {stable}{value}"
    if has_indefinite_weights(game):
        yield "the weights are indefinite: optimal among policies under which the state goes to 0"
    if warning := warning_of(certificate.data_change):
        yield warning
    if equation.is_disturbed:
        if game.is_discrete:
            yield "the disturbance pays: delta^2 - E'P E > 0"
        yield f"L is enclosed with the radius {_radius_of_L(enclosure):.1g}"


def _radius_of_L(enclosure: Enclosure) -> float:
    """Return the largest radius of L, relative to the largest entry of its row in units of the
    proof; inf if no digit of a row is known.
    """
    with precision(enclosure.bits):
        L = Balls(enclosure.L)
    sizes = np.exp2(enclosure.units.states.astype(float))
    with np.errstate(all="ignore"):
        largest = (np.abs(L.midpoint) * sizes).max(1, keepdims=True)
        relative = np.where(L.radius > 0.0, L.radius * sizes / largest, 0.0)
    worst = float(relative.max())
    return worst if math.isfinite(worst) else math.inf


def warning_of(change: float) -> str:
    """Return that the last digits of a game decide on its solution, as one sentence, or "".

    change: `data_change` of the solution
    """
    if change <= DETERMINED:
        return ""
    if change < 1.0:
        return f"the last digits of the data change the solution by up to {100.0 * change:.2g} %"
    return "the last digits of the data decide on the solution, which may not exist"


def data_change(enclosure: Enclosure) -> float:
    """Return the largest change of the sum of the relative changes of all P_ii, to the first order,
    where each entry of the game changes in its last digit; inf if that fails.

    P changes by Z of F'Z + Z F + c = 0, where c has the changes of the entries times P, K and L.
    With V of F V + V F' + W = 0 and W = diag(1 / P_ii), the sum is tr(W Z) = tr(V c), which is
    linear in each entry: the magnitudes of its factors are added. Likewise in discrete time.
    """
    with np.errstate(all="ignore"), precision(enclosure.bits):
        try:
            change = _data_change(enclosure)
        except (FailedError, np.linalg.LinAlgError, ValueError, ZeroDivisionError):
            return math.inf
    return change if math.isfinite(change) else math.inf


def _data_change(enclosure: Enclosure) -> float:
    """Return `data_change`."""
    found, game = enclosure.proved, enclosure.game
    equation, (states, inputs, disturbances, exact_T) = found.bounds, enclosure.units
    of = equation.arithmetic.of
    F = equation.loop(of(found.X), of(found.gains)).midpoint
    P = enclosure.value_in_units
    sizes = sizes_of(P.midpoint)
    is_known = sizes > np.diag(P.radius)
    weights = np.where(is_known, 1.0 / np.where(is_known, sizes, 1.0), 0.0)
    T = from_T = np.eye(len(F))
    if exact_T is not None:
        T, from_T = midpoints(exact_T), midpoints(exact_T.inv())
    V = from_T @ _adjoint(F, (T * weights) @ T.T, is_discrete=equation.is_discrete) @ from_T.T
    gains = found.gains.midpoint @ T
    K, L = gains[: len(inputs)], -gains[len(inputs) :]
    E = np.ldexp(game.E, np.add.outer(-states, disturbances))
    if not equation.is_disturbed:
        L = 0.0 * E.T
    elif not equation.is_discrete:
        L = float(equation.w) * E.T @ P.midpoint
    of_F = P.midpoint @ (from_T @ F @ T @ V if equation.is_discrete else V)
    twice = 2.0 * math.sqrt(game.discount) * of_F
    terms = (
        (twice, game.A, -states, states),
        (twice @ K.T, game.B, -states, inputs),
        (twice @ L.T, game.E, -states, disturbances),
        (V, game.Q, states, states),
        (2.0 * V @ K.T, game.N, states, inputs),
        (K @ V @ K.T, game.R, inputs, inputs),
    )
    total = sum(
        float((np.abs(factor) * np.abs(np.ldexp(matrix, np.add.outer(rows, columns)))).sum())
        for factor, matrix, rows, columns in terms
    )
    return np.finfo(float).eps * total


def _adjoint(F: np.ndarray, W: np.ndarray, *, is_discrete: bool) -> np.ndarray:
    """Return V of F V + V F' + W = 0, in discrete time F V F' - V + W = 0, in bits if necessary."""
    V = lyapunov_of(F.T, is_discrete=is_discrete).solve(-W)
    rest = (F @ V @ F.T - V if is_discrete else F @ V + V @ F.T) + W
    if np.abs(rest).max() < 0.1 * np.abs(W).max() and (np.diag(V) >= 0.0).all():
        return V
    return midpoints(lyapunov_in_bits(ball_matrix(F.T), ball_matrix(W), is_discrete=is_discrete))
