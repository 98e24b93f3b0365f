"""Proposals of solutions, in doubles or in many bits. `proof` decides what they prove."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    Balls,
    DoubleBalls,
    ExactMatrix,
    ball_matrix,
    bits,
    identity,
    midpoints,
    norm,
    part,
    symmetric,
)
from controller.riccati.equation import (
    ContinuousEquation,
    Equation,
    StepEquation,
    Units,
    change_along,
    equation_of,
    users_units,
)
from controller.riccati.lyapunov import Lyapunov
from controller.riccati.pairs import Pairs
from hfa_support.matrices import balanced, spectral_radius

if TYPE_CHECKING:
    from flint import arb, arb_mat

    from controller.riccati.proof import Stabilizing

# These choose proposals only: the proof decides.

#: Exponents of entries of this size are left as they are.
MODERATE = 12
#: Exponents of the user's units that differ by no more from those in which P is near 1 are left,
SAME = 2
#: and exponents that differ by more from those of a first proposal need another one.
NEAR = 10
#: Largest numbers of corrections of a proposal in doubles, of steps of Newton's method for the sign
#: function, and of doublings.
CORRECTIONS, NEWTON_STEPS, DOUBLINGS = 6, 150, 80
#: Smallest number of states for which `Pairs` are faster than `Balls` of `BITS`.
MANY_STATES = 20
#: A relative correction of X that is far below its last digit in doubles.
SMALL = 1e-25


class FailedError(Exception):
    """Raised if no solution can be proposed, with the step that fails."""


class Proposal(NamedTuple):
    """Proposed solution of a Riccati equation, for `proof`.

    equation: the equation, in the arithmetic of X
    X: (n, n)
    Y: (n, n), of the loop of both players
    lyapunov: solver of the Lyapunov equation of that loop in doubles, if there is one
    """

    equation: Equation[Any]
    X: ExactMatrix
    Y: arb_mat | np.ndarray
    lyapunov: Lyapunov | None = None


def in_doubles(game: Game, delta: float) -> Proposal:
    """Return a proposal by LAPACK, corrected by residuals.

    Raises FailedError.
    """
    with _failures():
        return _corrected(*_uncorrected(game, delta))


def proposal_of(equation: Equation[DoubleBalls]) -> Proposal:
    """Return a proposal by LAPACK in the given states, corrected by residuals.

    Raises FailedError.
    """
    with _failures():
        return _corrected(equation, stabilizing_in_doubles(equation))


def value_in_doubles(game: Game) -> np.ndarray:
    """Return P, (n, n), by LAPACK, which nothing corrects or proves.

    Raises FailedError.
    """
    with _failures():
        equation, X = _uncorrected(game, game.delta)
        states = equation.units.states
        return np.ldexp(X, -np.add.outer(states, states))


@contextmanager
def _failures() -> Iterator[None]:
    """Raise FailedError where arithmetic in doubles fails."""
    with np.errstate(all="ignore"):
        try:
            yield
        except (np.linalg.LinAlgError, ValueError, ZeroDivisionError, OverflowError) as failure:
            raise FailedError(str(failure)) from None


def _uncorrected(game: Game, delta: float) -> tuple[Equation[DoubleBalls], np.ndarray]:
    """Return the equation in units in which P is near 1, and its X, (n, n), by LAPACK."""
    equation = equation_of(game, first_units(game, delta), DoubleBalls, delta)
    X = stabilizing_in_doubles(equation)
    for _ in range(2):
        units = units_of_solution(game, equation.units, X, delta)
        steps = units.states - equation.units.states
        farthest = np.abs(steps).max()
        if farthest <= SAME and not any(each.any() for each in (units.inputs, units.disturbances)):
            break
        equation = equation_of(game, units, DoubleBalls, delta)
        X = np.ldexp(X, np.add.outer(steps, steps))
        if farthest <= NEAR:
            break
        X = stabilizing_in_doubles(equation)
    return equation, X


def _corrected(bounds: Equation[DoubleBalls], X: np.ndarray) -> Proposal:
    """Return a proposal about X, (n, n), corrected by residuals."""
    arithmetic: type[Any] = Pairs if len(X) >= MANY_STATES else Balls
    equation: Equation[Any] = bounds.with_arithmetic(arithmetic)
    lyapunov = lyapunov_of(loop_in_doubles(bounds, X), is_discrete=equation.is_discrete)
    exact, size = arithmetic.of(X).symmetric(), np.abs(X).max()
    for _ in range(CORRECTIONS):
        _, residual = equation.gains_and_residual(exact)
        correction, _ = lyapunov.solve(-residual.midpoint)
        if not np.abs(correction).max() > SMALL * size:
            break
        exact = (exact + arithmetic.of(correction)).mid()
    Y, _ = lyapunov.solve(-np.eye(len(X)))
    return Proposal(equation, exact, Y, lyapunov)


def lyapunov_of(F: np.ndarray, *, is_discrete: bool) -> Lyapunov:
    """Return the solver of the Lyapunov equation of a loop, in discrete time of Stein's."""
    return Lyapunov.of_steps(F) if is_discrete else Lyapunov(F)


def stabilizing_in_doubles(equation: Equation[DoubleBalls]) -> np.ndarray:
    """Return the stabilizing X, (n, n), by LAPACK."""
    if isinstance(equation, StepEquation):
        try:
            X = by_doubling(equation)
        except np.linalg.LinAlgError:  # R is singular
            X = by_deflation(equation)
        else:  # not the stabilizing X if an unstable mode has no cost
            if not spectral_radius(loop_in_doubles(equation, X)) < 1.0:
                X = by_deflation(equation)
    else:
        assert isinstance(equation, ContinuousEquation)
        X = by_schur_form(equation)
    if not np.isfinite(X).all():
        raise FailedError("the proposal is not finite")
    return X


def loop_in_doubles(equation: Equation[DoubleBalls], X: np.ndarray) -> np.ndarray:
    """Return the loop of both players at X, (n, n)."""
    gains = X  # not used in continuous time
    if isinstance(equation, StepEquation):
        G, A = equation.G.midpoint, equation.A.midpoint
        right = G.T @ X @ A + equation.C.midpoint.T
        gains = np.linalg.solve(equation.W.midpoint + G.T @ X @ G, right)
    return equation.loop(DoubleBalls.of(X), DoubleBalls.of(gains)).midpoint


def by_schur_form(equation: ContinuousEquation[DoubleBalls]) -> np.ndarray:
    """Return X of the stable subspace of the Hamiltonian, (n, n)."""
    from scipy.linalg.lapack import dgees

    n = equation.n
    free, S, cost = (each.midpoint for each in (equation.free, equation.S, equation.cost))
    H = np.concatenate([np.concatenate([free, -S], 1), np.concatenate([-cost, -free.T], 1)])
    _, stable, _, _, basis, _, _ = dgees(_is_stable, np.asarray_chkfinite(H), sort_t=1)
    if stable != n:
        raise FailedError(f"the Hamiltonian has {stable} stable eigenvalues instead of {n}")
    X = np.linalg.solve(basis[:n, :n].T, basis[n:, :n].T)
    return (X + X.T) / 2.0


def _is_stable(real: float, imaginary: float) -> bool:
    return real < 0.0


def by_doubling(equation: StepEquation[DoubleBalls]) -> np.ndarray:
    """Return the limit of 2^k steps, (n, n).

    Source: Anderson, International Journal of Control 28 (1978), 295-306.
    """
    m = equation.R.rows
    W, C = equation.W.midpoint, equation.C.midpoint
    G, A, Q = equation.G.midpoint, equation.A.midpoint, equation.Q.midpoint
    F = np.linalg.solve(W[:m, :m], C[:, :m].T)
    A, H = A - G[:, :m] @ F, Q - C[:, :m] @ F
    S = G @ np.linalg.solve(W, G.T)
    one = np.eye(len(A))
    for _ in range(DOUBLINGS):
        both = np.linalg.solve(one + S @ H, np.concatenate([A, S], 1))
        ahead, through = both[:, : len(A)], both[:, len(A) :]
        growth = A.T @ H @ ahead
        A, S, H = A @ ahead, S + A @ through @ A.T, H + growth
        S, H = (S + S.T) / 2.0, (H + H.T) / 2.0
        if not np.abs(growth).max() > 1e-14 * np.abs(H).max():
            return H
    raise FailedError("the doublings do not converge")


def by_deflation(equation: StepEquation[DoubleBalls]) -> np.ndarray:
    """Return X of the stable subspace of the pencil, (n, n), also if R is singular.

    Source: Van Dooren, SIAM Journal on Scientific and Statistical Computing 2 (1981), 121-135.
    """
    from scipy.linalg import ordqz

    n = equation.n
    pencil = equation.with_arithmetic(Balls)
    assert isinstance(pencil, StepEquation)
    L, M = map(midpoints, pencil.pencil())
    _, _, above, below, _, basis = ordqz(L, M, sort="iuc", output="real")
    stable = int((np.abs(above) < np.abs(below)).sum())
    if stable != n:
        raise FailedError(f"the pencil has {stable} stable eigenvalues instead of {n}")
    X = np.linalg.solve(basis[:n, :n].T, basis[n : 2 * n, :n].T)
    return (X + X.T) / 2.0


def first_units(game: Game, delta: float) -> Units:
    """Return units in which the Hamiltonian is balanced, or the user's if they are moderate.

    Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22 (2001).
    """
    entries = np.concatenate([each.ravel() for each in (game.A, game.B, game.E, game.Q, game.R)])
    exponents = np.frexp(entries[entries != 0.0])[1]
    if np.abs(exponents).max(initial=0) <= MODERATE:
        return users_units(game)
    price = _prices(game, game.B, game.Q)
    S = (game.B / np.where(price > 0.0, price, 1.0)) @ game.B.T + game.E @ game.E.T / delta**2
    H = np.concatenate([np.concatenate([game.A, S], 1), np.concatenate([game.Q, game.A.T], 1)])
    of_states, of_costates = np.split(np.log2(balanced(H)[1]), 2)
    states = np.round(0.5 * (of_states - of_costates)).astype(int)
    return Units(states, -_half_exponents(price), disturbance_units(game, delta))


def units_of_solution(game: Game, units: Units, X: np.ndarray, delta: float) -> Units:
    """Return units in which the diagonal of X, and the prices of the players, are nearly 1.

    units: of X
    X: (n, n)
    """
    steps = -_half_exponents(np.diag(X))
    states = units.states + steps
    B = np.ldexp(game.B, -states[:, None])
    price = _prices(game, B, np.ldexp(X, np.add.outer(steps, steps)))
    return Units(states, -_half_exponents(price), disturbance_units(game, delta))


def _prices(game: Game, B: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return the diagonal of R, in discrete time of R + α B'X B, (m,)."""
    price = np.diag(game.R).astype(float)
    if game.is_discrete:
        price = price + game.discount * np.einsum("ij,ij->j", B, X @ B)
    return price


def disturbance_units(game: Game, delta: float) -> np.ndarray:
    """Return units of the disturbances, (k,) integers, in which δ is nearly 1 in discrete time."""
    exponent = math.frexp(delta)[1] if game.is_discrete and math.isfinite(delta) else 0
    return np.full(game.E.shape[1], -exponent)


def _half_exponents(values: np.ndarray) -> np.ndarray:
    """Return the exponents of the roots of positive values, and 0 for others."""
    positive = np.where((values > 0.0) & np.isfinite(values), values, 1.0)
    return np.round(0.5 * np.log2(positive)).astype(int)


def loop_units(F: np.ndarray) -> np.ndarray:
    """Return units of the states, exponents of two, in which a loop is balanced, (n,) integers."""
    return np.round(np.log2(balanced(F)[1])).astype(int)


def lyapunov_in_bits(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat:
    """Return a proposal for the solution of F'D + D F + C = 0, (n, n), in as many bits.

    By LAPACK, corrected by residuals in balls; by the matrix sign function if they do not shrink.
    In discrete time, the equation is F'D F - D + C = 0.

    Raises FailedError.
    """
    try:
        D, residual_size = _refined_lyapunov(loop, C, is_discrete=is_discrete)
        if residual_size <= norm(C) * half_the_bits() or residual_size == 0:
            return D
    except (np.linalg.LinAlgError, ValueError):
        pass
    return squared_steps(loop, C) if is_discrete else by_sign_function(loop, C)


class _Refined(NamedTuple):
    """Proposed solution D of a Lyapunov equation, (n, n), and the norm of its residual."""

    D: arb_mat
    residual_size: arb


def _refined_lyapunov(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> _Refined:
    """Return D by LAPACK, corrected by residuals in balls as long as each is a tenth of the last.

    Raises LinAlgError or ValueError where LAPACK fails.
    """
    from flint import arb

    solver = lyapunov_of(midpoints(loop), is_discrete=is_discrete)
    F = Balls(loop.mid())
    D = ball_matrix(solver.solve(-midpoints(C))[0])
    size_before = arb("inf")
    while True:
        residual = change_along(F, Balls(D), is_discrete=is_discrete).matrix + C.mid()
        size = norm(residual.mid())
        if not size < size_before * 0.1:
            return _Refined(D, size)
        size_before = size
        D = (D + ball_matrix(solver.solve(-midpoints(residual))[0])).mid()


def squared_steps(loop: arb_mat, C: arb_mat) -> arb_mat:
    """Return the sum D of F'^k C F^k by doubling the number of steps, (n, n).

    Raises FailedError if it does not converge.
    """
    F, D = loop.mid(), C.mid()
    for _ in range(DOUBLINGS):
        more = (F.transpose() * D * F).mid()
        D, F = (D + more).mid(), (F * F).mid()
        if norm(more) <= norm(D) * _last_bits():
            return D
        if not norm(F).is_finite():
            break
    raise FailedError("the steps do not decay")


def by_sign_function(loop: arb_mat, C: arb_mat) -> arb_mat:
    """Return D of F'D + D F + C = 0 by Newton's method for the sign of [[F, 0], [C, -F']], (n, n).

    Source: Roberts, International Journal of Control 32 (1980), 677-687.
    Raises FailedError if it does not converge.
    """
    F, D = loop.mid(), C.mid()
    for step in range(NEWTON_STEPS):
        inverse = _inverse(F)
        scale = _newton_scale(F, inverse, step)
        D = ((D * scale + inverse.transpose() * D * inverse * (1 / scale)) * 0.5).mid()
        further = ((F * scale + inverse * (1 / scale)) * 0.5).mid()
        if scale == 1 and norm(further - F) <= norm(further) * half_the_bits():
            return (D * 0.5).mid()
        F = further
    raise FailedError("the loop may be on the axis")


def sign_function(matrix: arb_mat) -> arb_mat:
    """Return the matrix sign function by Newton's method.

    Raises FailedError if it does not converge.
    """
    for step in range(NEWTON_STEPS):
        inverse = _inverse(matrix)
        scale = _newton_scale(matrix, inverse, step)
        further = ((matrix * scale + inverse * (1 / scale)) * 0.5).mid()
        if scale == 1 and norm(further - matrix) <= norm(further) * half_the_bits():
            return ((further + _inverse(further)) * 0.5).mid()
        matrix = further
    raise FailedError("an eigenvalue may be on the axis")


def _inverse(matrix: arb_mat) -> arb_mat:
    try:
        return matrix.inv().mid()
    except ZeroDivisionError:
        raise FailedError("a matrix is singular with these bits") from None


def _newton_scale(matrix: arb_mat, inverse: arb_mat, step: int) -> arb:
    """Return the factor of a Newton step that brings the eigenvalues near to 1 soon, or 1."""
    from flint import arb

    factor = (norm(inverse) / norm(matrix)).sqrt().mid()
    is_near = bool(factor > 0.9) and bool(factor < 1.1)
    return arb(1) if is_near or step > NEWTON_STEPS // 2 else factor


def half_the_bits() -> arb:
    """Return 2^(-bits/2): after a Newton step as small, the next is exact up to the last bits."""
    from flint import arb

    return arb(2) ** (-bits() // 2)


def _last_bits() -> arb:
    from flint import arb

    return arb(2) ** (10 - bits())


def proposal_in_bits(game: Game, delta: float) -> Proposal:
    """Return a proposal with as many bits as `precision` gives.

    Raises FailedError.
    """
    units = first_units(game, delta)
    with np.errstate(all="ignore"):
        first = in_bits(equation_of(game, units, Balls, delta))
        further = units_of_solution(game, units, first.X.midpoint, delta)
        if all(map(np.array_equal, units, further)):
            return first
        return in_bits(equation_of(game, further, Balls, delta))


def corrected(proposal: Proposal) -> Proposal:
    """Return a proposal of LAPACK, corrected by residuals as long as they shrink.

    Raises FailedError.
    """
    equation, X = proposal.equation.with_arithmetic(Balls), Balls.of(proposal.X)
    with np.errstate(all="ignore"):
        try:
            gains, residual = equation.gains_and_residual(X)
            F = equation.loop(X, gains).midpoint
            solver = lyapunov_of(F, is_discrete=equation.is_discrete)
            before = None
            for _ in range(NEWTON_STEPS):
                size = residual.mid().norm()
                if before is not None and not size < 0.5 * before:
                    break
                before = size
                X = (X + Balls.of(solver.solve(-residual.midpoint)[0])).mid()
                gains, residual = equation.gains_and_residual(X)
        except (np.linalg.LinAlgError, ValueError, ZeroDivisionError) as failure:
            raise FailedError(str(failure)) from None
    loop = equation.loop(X, gains).matrix.mid()
    Y = lyapunov_in_bits(loop, identity(equation.n), is_discrete=equation.is_discrete)
    return Proposal(equation, X, Y)


def in_bits(equation: Equation[Balls]) -> Proposal:
    """Return a proposal by the matrix sign function.

    equation: in `Balls`

    Raises FailedError.
    """
    try:
        X = Balls(symmetric(_of_stable_subspace(equation)))
        gains, _ = equation.gains_and_residual(X)
    except ZeroDivisionError:
        raise FailedError("a matrix is singular with these bits") from None
    loop = equation.loop(X, gains).matrix.mid()
    Y = lyapunov_in_bits(loop, identity(equation.n), is_discrete=equation.is_discrete)
    return Proposal(equation, X, Y)


def of_control_loop(found: Stabilizing[Any]) -> arb_mat:
    """Return a proposal for Y of the loop without disturbance, (n, n).

    Raises FailedError.
    """
    equation = found.equation
    P = Balls.around(found.X, found.spread)
    loop = equation.control_loop(P, Balls(found.gains)).matrix
    return lyapunov_in_bits(loop, identity(equation.n), is_discrete=equation.is_discrete)


def _of_stable_subspace(equation: Equation[Balls]) -> arb_mat:
    """Return X = X2 X1⁻¹ of the basis [X1; X2] of the stable subspace, (n, n)."""
    n = equation.n
    if isinstance(equation, StepEquation):
        L, M = equation.pencil()
        # The stable eigenvalues, |z| < 1, are those of (L + M)⁻¹ (L - M) with Re < 0.
        matrix = (L + M).mid().solve((L - M).mid()).mid()
    else:
        assert isinstance(equation, ContinuousEquation)
        matrix = equation.hamiltonian().mid()
    sign = sign_function(matrix)
    size = matrix.nrows()
    stable = (identity(size) - sign).mid()
    dimension = sum((stable[i, i] for i in range(size)), 0 * stable[0, 0]) / 2
    if not abs(dimension - n) < 0.5:
        raise FailedError(f"{float(dimension):.0f} stable eigenvalues instead of {n}")
    columns = np.random.default_rng(1).normal(size=(size, n))
    basis = (stable * ball_matrix(columns)).mid()
    X1, X2 = part(basis, slice(n), slice(None)), part(basis, slice(n, 2 * n), slice(None))
    return X1.transpose().mid().solve(X2.transpose().mid()).transpose().mid()
