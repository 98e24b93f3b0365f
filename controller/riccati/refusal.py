"""Proofs that a game has no value.

Sources: Zhou, Doyle and Glover, Robust and Optimal Control, Theorems 13.7 and 13.20 and Chapter 16;
Basar and Bernhard, H-infinity Optimal Control, Theorems 3.7 and 4.11.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import Balls, ball_matrix, midpoints
from controller.riccati.equation import Bound, ContinuousEquation, Equation, StepEquation
from controller.riccati.proof import Stabilizing
from controller.riccati.rationals import (
    Boundary,
    boundary_of,
    boundary_root,
    rational,
    rational_root,
    unreachable_modes,
    unstable_root,
)
from hfa_support.errors import NoSolutionError

if TYPE_CHECKING:
    from flint import acb, arb_mat, fmpz_poly

#: An eigenvalue whose real part is below this fraction of its size may be on the axis. It proposes
#: frequencies only: the sign of a determinant decides.
MAYBE_ON_AXIS = 1e-4


class ModeError(NoSolutionError):
    """Raised if a mode that no input reaches, or an undamped mode without cost, is the reason why
    no delta has a solution.
    """


def why_no_value(
    equation: Equation[Balls], found: Stabilizing[Bound] | None, *, in_bits: bool
) -> str:
    """Return a reason, proved, why the game has no value, or "".

    equation: of the game, in `Balls`
    found: the ball of the stabilizing solution, None if there is no proof of one
    in_bits: whether proposals are computed in many bits, for what doubles do not see
    """
    if found is not None:
        if not equation.is_disturbed:
            return ""
        return _unpaid(found) or _indefinite(found) or _crossing(equation, in_bits=in_bits)
    return _crossing(equation, in_bits=in_bits)


def _crossing(equation: Equation[Balls], *, in_bits: bool) -> str:
    """Return a frequency, proved, at which the disturbance gains too much for every input, or "".

    The determinant of the pencil at a frequency is real. It has another sign than without
    disturbance (in continuous time, than at infinite frequency) only if an eigenvalue is on the
    boundary of stability, for this or a larger delta.
    """
    if not equation.is_disturbed:
        return ""
    frequencies = _between_eigenvalues(equation, in_bits=in_bits)
    return next(filter(None, (too_large_at(equation, each) for each in frequencies)), "")


def too_large_at(equation: Equation[Balls], frequency: float) -> str:
    """Return that the gain from the disturbance is proved too large at a frequency, or ""."""
    if not equation.is_disturbed or _sign(equation, frequency) != -1:
        return ""
    unit = "rad/step" if equation.is_discrete else "rad/s"
    return (
        f"for every input, the gain from the disturbance is at least {equation.delta:.6g}"
        f" (at {frequency:.4g} {unit})"
    )


def _between_eigenvalues(equation: Equation[Balls], *, in_bits: bool) -> list[float]:
    """Return frequencies between those of the eigenvalues that may be on the boundary."""
    values = _eigenvalues_in_bits(equation) if in_bits else _eigenvalues(equation)
    values = values[np.isfinite(values)]
    if equation.is_discrete:  # the axis of (z - 1) / (z + 1)
        with np.errstate(all="ignore"):
            values = (values - 1.0) / (values + 1.0)
        values = values[np.isfinite(values)]
    near = np.abs(values.real) <= MAYBE_ON_AXIS * np.abs(values)
    frequencies = np.unique(np.abs(values.imag[near]))
    if equation.is_discrete:
        frequencies = 2.0 * np.arctan(frequencies)
    ends = [0.0, *frequencies.tolist()]
    if equation.is_discrete:
        ends.append(math.pi)
    between = [(low + high) / 2.0 for low, high in pairwise(ends)]
    widths = np.argsort([low - high for low, high in pairwise(ends)])
    return [0.0, *(between[i] for i in widths), *ends[-1:]][: 2 * equation.n + 2]


def _eigenvalues(equation: Equation[Balls]) -> np.ndarray:
    """Return the eigenvalues of the Hamiltonian, or of the pencil, in doubles."""
    from scipy.linalg import eigvals

    with np.errstate(all="ignore"):
        try:
            if isinstance(equation, StepEquation):
                return np.asarray(eigvals(*map(midpoints, equation.pencil())))
            assert isinstance(equation, ContinuousEquation)
            return np.linalg.eigvals(midpoints(equation.hamiltonian()))
        except (np.linalg.LinAlgError, ValueError):
            return np.zeros(0, dtype=complex)


def _eigenvalues_in_bits(equation: Equation[Balls]) -> np.ndarray:
    """Return the eigenvalues with many bits, rounded to doubles."""
    from flint import acb_mat

    try:
        if isinstance(equation, StepEquation):
            L, M = equation.pencil()
            cayley = (L + M).mid().solve((L - M).mid()).mid()
            values = acb_mat(cayley).eig(algorithm="approx")
            found = np.array([complex(value) for value in values])
            with np.errstate(all="ignore"):
                return (1.0 + found) / (1.0 - found)
        assert isinstance(equation, ContinuousEquation)
        values = acb_mat(equation.hamiltonian().mid()).eig(algorithm="approx")
        return np.array([complex(value) for value in values])
    except (ZeroDivisionError, ValueError):
        return np.zeros(0, dtype=complex)


def _sign(equation: Equation[Balls], frequency: float) -> int:
    """Return the sign of the determinant at a frequency, relative to that without disturbance;
    0 if it is not proved.
    """
    from flint import acb

    if isinstance(equation, StepEquation):
        with_none = StepEquation(equation.game, equation.units, Balls, math.inf)
        z = acb(0, frequency).exp()
        turned = acb(0, -frequency * equation.n).exp()
        # Each column of E has the entry -1/w in the pencil.
        usual = _sign_of(_determinant(*with_none.pencil(), z) * turned)
        usual *= (-1) ** equation.E.matrix.ncols()
        here = _sign_of(_determinant(*equation.pencil(), z) * turned)
        return usual * here
    assert isinstance(equation, ContinuousEquation)
    H = equation.hamiltonian()
    one = ball_matrix(np.eye(2 * equation.n))
    at_infinity = (-1) ** equation.n
    return at_infinity * _sign_of(_determinant(H, one, acb(0, frequency)))


def _determinant(L: arb_mat, M: arb_mat, z: acb) -> acb:
    from flint import acb_mat

    return (acb_mat(L) - acb_mat(M) * z).det()


def _sign_of(value: acb) -> int:
    return 1 if value.real > 0 else -1 if value.real < 0 else 0


def _unpaid(found: Stabilizing[Bound]) -> str:
    """Return that the disturbance does not pay, proved by one disturbance, or ""."""
    equation = found.equation
    price = equation.disturbance_price(found.P_in_balls)
    if price is not None and _is_negative(price.matrix):
        return (
            f"in one step, the disturbance gains more than {equation.delta:.6g} squared of its cost"
        )
    return ""


def _indefinite(found: Stabilizing[Bound]) -> str:
    """Return that P is indefinite, proved by one direction, or ""."""
    if _is_negative(found.P_in_balls.matrix):
        return "P is indefinite"
    return ""


def _is_negative(matrix: arb_mat) -> bool:
    """Return whether v'M v < 0 is proved for one vector v, an eigenvector in doubles."""
    middle = midpoints(matrix)
    if not np.isfinite(middle).all():
        return False
    units = np.exp2(
        -np.round(0.5 * np.log2(np.where(np.diag(middle) != 0.0, np.abs(np.diag(middle)), 1.0)))
    )
    vectors = np.linalg.eigh(middle * np.outer(units, units))[1]
    v = ball_matrix(units[:, None] * vectors[:, :1])
    return bool((v.transpose() * matrix * v)[0, 0] < 0)


def why_never(game: Game) -> str:
    """Return the mode because of which no delta has a value, decided in rationals, or "".

    Without a disturbance, the stabilizing solution exists if and only if the inputs reach all
    modes that are not stable, and all undamped modes have a cost.
    """
    root = rational_root(game.discount)
    growth = 1.0 if root is not None else math.sqrt(game.discount)
    A, B = rational(game.A) * (root or 1), rational(game.B)
    unreached = _unstable(unreachable_modes(A, B), growth, game)
    if unreached:
        return (
            f"(A, B) is not stabilizable: no input reaches the {unreached}; change B or leave that"
            " mode out of A"
        )
    Q, R, N = (rational(each) for each in (game.Q, game.R, game.N))
    Q, R = (Q + Q.transpose()) / 2, (R + R.transpose()) / 2
    if R.rank() == R.nrows():
        over_R = R.solve(N.transpose()) * (root or 1)
        cost = Q - N * R.solve(N.transpose())
        free_of_cost = unreachable_modes((A - B * over_R).transpose(), cost)
        undamped = None
        if free_of_cost is not None and growth == 1.0:
            undamped = boundary_root(free_of_cost, is_discrete=game.is_discrete)
        if undamped is not None:
            return (
                f"(A, Q) is not detectable: the undamped {_name(undamped, game)} has no cost; give"
                " it weight in Q"
            )
    return ""


def why_never_at(game: Game, delta: float) -> str:
    """Return that an eigenvalue of the pencil is exactly on the boundary of stability, or ""."""
    boundary = boundary_of(game, delta)
    if boundary is Boundary.SINGULAR:
        return (
            "R + B'P B is singular for every P: an input neither costs nor acts; give it a weight"
            " in R, or leave it out of B"
        )
    if boundary is Boundary.CLEAR:
        return ""
    if math.isinf(delta):
        return "an undamped motion has no cost, whatever the input; give it weight in Q"
    return f"for every input, the gain from the disturbance is at least {delta:.6g}"


def _unstable(modes: fmpz_poly | None, growth: float, game: Game) -> str:
    """Return the name of a root that is not stable, or ""."""
    if modes is None:
        return ""
    root = unstable_root(modes, growth, is_discrete=game.is_discrete)
    return "" if root is None else _name(root * growth, game)


def _name(value: complex, game: Game) -> str:
    """Return the name of a mode for a message, "mode with eigenvalue 0.5 ± 1i"."""
    pair = f" ± {abs(value.imag):.4g}i" if value.imag else ""
    whose = " of sqrt(discount) A" if game.is_discrete else ""
    return f"mode with eigenvalue {value.real + 0.0:.4g}{pair}{whose}"
