"""Proposals of solutions, in doubles or in many bits. `proof` decides what they prove.

In doubles, LAPACK solves the Riccati equation (`proposal_in_doubles`). Its X is corrected by
Newton's method with residuals of more digits, there and in balls (`corrected_in_bits`). Where
doubles do not suffice, the matrix sign function finds X in many bits (`proposal_in_bits`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import hamiltonian
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
    X: (n, n), its solution
    Y: (n, n), solution of F'Y + Y F = -1 with the loop F of both players at X, in discrete time of
        F'Y F - Y = -1
    lyapunov: solver of the Lyapunov equation of that loop in doubles, if there is one
    """

    equation: Equation[Any]
    X: ExactMatrix
    Y: arb_mat | np.ndarray
    lyapunov: Lyapunov | None = None


def proposal_in_doubles(game: Game, delta: float, residuals: type[Any] | None = None) -> Proposal:
    """Return a proposal by LAPACK in units in which P is near 1, corrected by residuals.

    residuals: as for `_corrected`

    Raises FailedError.
    """
    with _failures():
        return _corrected(*_solved_by_lapack(game, delta), residuals)


def proposal_of(equation: Equation[DoubleBalls]) -> Proposal:
    """Return a proposal by LAPACK in the states of an equation, corrected by residuals.

    Raises FailedError.
    """
    with _failures():
        return _corrected(equation, stabilizing_in_doubles(equation))


def corrected_in_doubles(game: Game, delta: float) -> Proposal:
    """Return a proposal by LAPACK, corrected with the bits of `precision`.

    Raises FailedError.
    """
    return corrected_in_bits(proposal_in_doubles(game, delta))


def value_in_doubles(game: Game) -> np.ndarray:
    """Return P, (n, n), by LAPACK, which nothing corrects or proves.

    Raises FailedError.
    """
    with _failures():
        equation, X = _solved_by_lapack(game, game.delta)
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


class _Solved(NamedTuple):
    """Equation in some units, and its stabilizing solution X in doubles, (n, n)."""

    equation: Equation[DoubleBalls]
    X: np.ndarray


def _solved_by_lapack(game: Game, delta: float) -> _Solved:
    """Return the equation in units in which P is near 1, solved by LAPACK.

    The units follow from a first solution. If they differ much from those in which it was computed,
    the equation is solved again.
    """
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
    return _Solved(equation, X)


def _corrected(
    in_doubles: Equation[DoubleBalls], X: np.ndarray, residuals: type[Any] | None = None
) -> Proposal:
    """Return a proposal about X, (n, n), corrected by residuals of more digits than doubles.

    Each correction Z solves F'Z + Z F + residual = 0 in doubles, with the loop F at X.

    residuals: `Balls`, or `Pairs`, which are faster for many states and have fewer digits; by
        default the faster ones
    """
    arithmetic: type[Any] = residuals or (Pairs if len(X) >= MANY_STATES else Balls)
    equation: Equation[Any] = in_doubles.with_arithmetic(arithmetic)
    lyapunov = lyapunov_of(loop_in_doubles(in_doubles, X), is_discrete=equation.is_discrete)
    corrected, size = arithmetic.of(X).symmetric(), np.abs(X).max()
    for _ in range(CORRECTIONS):
        _, residual = equation.gains_and_residual(corrected)
        correction, _ = lyapunov.solve(-residual.midpoint)
        if not np.abs(correction).max() > SMALL * size:
            break
        corrected = (corrected + arithmetic.of(correction)).mid()
    Y, _ = lyapunov.solve(-np.eye(len(X)))
    return Proposal(equation, corrected, Y, lyapunov)


def lyapunov_of(F: np.ndarray, *, is_discrete: bool) -> Lyapunov:
    """Return the solver of F'Z + Z F = C, in discrete time of F'Z F - Z = C."""
    return Lyapunov.of_steps(F) if is_discrete else Lyapunov(F)


def stabilizing_in_doubles(equation: Equation[DoubleBalls]) -> np.ndarray:
    """Return the stabilizing X, (n, n), by LAPACK, in doubles that nothing proves.

    Raises FailedError, LinAlgError or ValueError.
    """
    if isinstance(equation, StepEquation):
        try:
            X = riccati_by_doubling(equation)
        except np.linalg.LinAlgError:  # R is singular
            X = riccati_by_deflation(equation)
        else:  # not the stabilizing X if an unstable mode has no cost
            if not spectral_radius(loop_in_doubles(equation, X)) < 1.0:
                X = riccati_by_deflation(equation)
    else:
        assert isinstance(equation, ContinuousEquation)
        X = riccati_by_schur_form(equation)
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


def riccati_by_schur_form(equation: ContinuousEquation[DoubleBalls]) -> np.ndarray:
    """Return X of the stable subspace of the Hamiltonian, which [1; X] spans, (n, n)."""
    from scipy.linalg.lapack import dgees

    n = equation.n
    H = hamiltonian(equation.free.midpoint, equation.S.midpoint, equation.cost.midpoint)
    _, stable, _, _, basis, _, _ = dgees(_is_stable, np.asarray_chkfinite(H), sort_t=1)
    if stable != n:
        raise FailedError(f"the Hamiltonian has {stable} stable eigenvalues instead of {n}")
    return _of_basis(basis[:n, :n], basis[n:, :n])


def _of_basis(states: np.ndarray, costates: np.ndarray) -> np.ndarray:
    """Return X, (n, n), of the subspace that the columns of [states; costates] span."""
    X = np.linalg.solve(states.T, costates.T)
    return (X + X.T) / 2.0


def _is_stable(real: float, imaginary: float) -> bool:
    """Return whether an eigenvalue of the Hamiltonian comes first in its Schur form."""
    return real < 0.0


def riccati_by_doubling(equation: StepEquation[DoubleBalls]) -> np.ndarray:
    """Return X, (n, n), the limit of the value of games of 2^k steps.

    Source: Anderson, International Journal of Control 28 (1978), 295-306.

    Raises LinAlgError if R is singular.
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


def riccati_by_deflation(equation: StepEquation[DoubleBalls]) -> np.ndarray:
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
    return _of_basis(basis[:n, :n], basis[n : 2 * n, :n])


def first_units(game: Game, delta: float) -> Units:
    """Return units in which the Hamiltonian is balanced, or the user's if they are moderate.

    Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci. Comput. 22 (2001).
    """
    matrices = game.A, game.B, game.E, game.Q, game.R
    entries = np.concatenate([matrix.ravel() for matrix in matrices])
    exponents = np.frexp(entries[entries != 0.0])[1]
    if np.abs(exponents).max(initial=0) <= MODERATE:
        return users_units(game)
    price = _prices(game, game.B, game.Q)
    S = (game.B / np.where(price > 0.0, price, 1.0)) @ game.B.T + game.E @ game.E.T / delta**2
    of_states, of_costates = np.split(np.log2(balanced(hamiltonian(game.A, S, game.Q))[1]), 2)
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
    """Return the price of each input, the diagonal of R, in discrete time of R + α B'X B, (m,)."""
    price = np.diag(game.R).astype(float)
    if game.is_discrete:
        price = price + game.discount * np.einsum("ij,ij->j", B, X @ B)
    return price


def disturbance_units(game: Game, delta: float) -> np.ndarray:
    """Return units of the disturbances, (k,) integers, in which δ is nearly 1 in discrete time."""
    exponent = math.frexp(delta)[1] if game.is_discrete and math.isfinite(delta) else 0
    return np.full(game.E.shape[1], -exponent)


def _half_exponents(values: np.ndarray) -> np.ndarray:
    """Return k with 2^k nearest to the root of each positive value, and 0 for others."""
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
    return lyapunov_by_doubling(loop, C) if is_discrete else lyapunov_by_sign_function(loop, C)


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


def lyapunov_by_doubling(loop: arb_mat, C: arb_mat) -> arb_mat:
    """Return D of F'D F - D + C = 0, (n, n), the sum of F'^k C F^k over more and more steps k.

    Raises FailedError if it does not converge.
    """
    F, D = loop.mid(), C.mid()
    for _ in range(DOUBLINGS):
        of_later_steps = (F.transpose() * D * F).mid()
        D, F = (D + of_later_steps).mid(), (F * F).mid()
        if norm(of_later_steps) <= norm(D) * _last_bits():
            return D
        if not norm(F).is_finite():
            break
    raise FailedError("the steps do not decay")


def lyapunov_by_sign_function(loop: arb_mat, C: arb_mat) -> arb_mat:
    """Return D of F'D + D F + C = 0 by Newton's method for the sign of [[F, 0], [C, -F']], (n, n).

    The sign is [[-1, 0], [2 D, 1]].

    Source: Roberts, International Journal of Control 32 (1980), 677-687.
    Raises FailedError if it does not converge.
    """
    F, D = loop.mid(), C.mid()
    for step in range(NEWTON_STEPS):
        inverse = _inverse(F)
        scale = _newton_scale(F, inverse, step)
        D = ((D * scale + inverse.transpose() * D * inverse * (1 / scale)) * 0.5).mid()
        next_F = ((F * scale + inverse * (1 / scale)) * 0.5).mid()
        if scale == 1 and norm(next_F - F) <= norm(next_F) * half_the_bits():
            return (D * 0.5).mid()
        F = next_F
    raise FailedError("the loop may be on the axis")


def sign_function(matrix: arb_mat) -> arb_mat:
    """Return the matrix sign function, the limit of (M + M⁻¹)/2 in each step (Newton).

    Raises FailedError if it does not converge.
    """
    for step in range(NEWTON_STEPS):
        inverse = _inverse(matrix)
        scale = _newton_scale(matrix, inverse, step)
        next_matrix = ((matrix * scale + inverse * (1 / scale)) * 0.5).mid()
        if scale == 1 and norm(next_matrix - matrix) <= norm(next_matrix) * half_the_bits():
            return ((next_matrix + _inverse(next_matrix)) * 0.5).mid()
        matrix = next_matrix
    raise FailedError("an eigenvalue may be on the axis")


def _inverse(matrix: arb_mat) -> arb_mat:
    """Return the inverse without radii.

    Raises FailedError if the matrix may be singular.
    """
    try:
        return matrix.inv().mid()
    except ZeroDivisionError:
        raise FailedError("a matrix is singular with these bits") from None


def _newton_scale(matrix: arb_mat, inverse: arb_mat, step: int) -> arb:
    """Return the factor c of a Newton step (c M + (c M)⁻¹)/2 that brings the eigenvalues near ±1
    soon; 1 where they are near, and in late steps.
    """
    from flint import arb

    factor = (norm(inverse) / norm(matrix)).sqrt().mid()
    is_near = bool(factor > 0.9) and bool(factor < 1.1)
    return arb(1) if is_near or step > NEWTON_STEPS // 2 else factor


def half_the_bits() -> arb:
    """Return 2^(-bits/2): after a Newton step as small, the next is exact up to the last bits."""
    from flint import arb

    return arb(2) ** (-bits() // 2)


def _last_bits() -> arb:
    """Return 2^(10 - bits): smaller changes are in the last bits."""
    from flint import arb

    return arb(2) ** (10 - bits())


def proposal_in_bits(game: Game, delta: float) -> Proposal:
    """Return a proposal with as many bits as `precision` gives.

    Raises FailedError.
    """
    units = first_units(game, delta)
    with np.errstate(all="ignore"):
        first = _by_sign_function(equation_of(game, units, Balls, delta))
        better_units = units_of_solution(game, units, first.X.midpoint, delta)
        if all(map(np.array_equal, units, better_units)):
            return first
        return _by_sign_function(equation_of(game, better_units, Balls, delta))


def corrected_in_bits(proposal: Proposal) -> Proposal:
    """Return a proposal of LAPACK, corrected in `Balls` as long as each residual is half the last.

    Raises FailedError.
    """
    equation, X = proposal.equation.with_arithmetic(Balls), Balls.of(proposal.X)
    with np.errstate(all="ignore"):
        try:
            gains, residual = equation.gains_and_residual(X)
            F = equation.loop(X, gains).midpoint
            solver = lyapunov_of(F, is_discrete=equation.is_discrete)
            size_before = None
            for _ in range(NEWTON_STEPS):
                size = residual.mid().norm()
                if size_before is not None and not size < 0.5 * size_before:
                    break
                size_before = size
                X = (X + Balls.of(solver.solve(-residual.midpoint)[0])).mid()
                gains, residual = equation.gains_and_residual(X)
        except (np.linalg.LinAlgError, ValueError, ZeroDivisionError) as failure:
            raise FailedError(str(failure)) from None
    return _with_Y(equation, X, gains)


def _with_Y(equation: Equation[Balls], X: Balls, gains: Balls) -> Proposal:
    """Return the proposal of X, whose gains are known, with Y of its loop.

    Raises FailedError.
    """
    loop = equation.loop(X, gains).matrix.mid()
    Y = lyapunov_in_bits(loop, identity(equation.n), is_discrete=equation.is_discrete)
    return Proposal(equation, X, Y)


def _by_sign_function(equation: Equation[Balls]) -> Proposal:
    """Return a proposal by the matrix sign function.

    Raises FailedError.
    """
    try:
        X = Balls(symmetric(_of_stable_subspace(equation)))
        gains, _ = equation.gains_and_residual(X)
    except ZeroDivisionError:
        raise FailedError("a matrix is singular with these bits") from None
    return _with_Y(equation, X, gains)


def lyapunov_of_control_loop(found: Stabilizing[Any]) -> arb_mat:
    """Return a proposal for Y of the loop F without disturbance, F'Y + Y F = -1, (n, n).

    In discrete time, F'Y F - Y = -1.

    Raises FailedError.
    """
    equation = found.equation
    loop = equation.control_loop(found.P_in_balls, Balls.of(found.gains)).matrix
    return lyapunov_in_bits(loop, identity(equation.n), is_discrete=equation.is_discrete)


def _of_stable_subspace(equation: Equation[Balls]) -> arb_mat:
    """Return X = X2 X1⁻¹ of a basis [X1; X2] of the stable subspace, (n, n).

    The columns of 1 - sign(M) span it, with the `half_plane_matrix` M.

    Raises FailedError or ZeroDivisionError.
    """
    n = equation.n
    matrix = equation.half_plane_matrix()
    size = matrix.nrows()
    stable = (identity(size) - sign_function(matrix)).mid()
    dimension = sum((stable[i, i] for i in range(size)), 0 * stable[0, 0]) / 2
    if not abs(dimension - n) < 0.5:
        raise FailedError(f"{float(dimension):.0f} stable eigenvalues instead of {n}")
    columns = np.random.default_rng(1).normal(size=(size, n))
    basis = (stable * ball_matrix(columns)).mid()
    X1, X2 = part(basis, slice(n), slice(None)), part(basis, slice(n, 2 * n), slice(None))
    return X1.transpose().mid().solve(X2.transpose().mid()).transpose().mid()
