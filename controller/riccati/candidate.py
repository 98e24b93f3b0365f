"""Candidate solutions of a Riccati equation, in doubles or in many bits. `stabilizing` judges them.

They are sought in states in which P is nearly 1: there, doubles have the digits that they lose in
the user's states. The matrix sign function finds X, in doubles or, where these do not suffice, in
many bits, and Newton's method corrects it by residuals in balls.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    BITS,
    Near,
    ball_matrix,
    bits,
    identity,
    midpoints,
    part,
    precision,
    symmetric,
)
from controller.riccati.equation import (
    Equation,
    Units,
)
from controller.riccati.lyapunov import (
    NEWTON_STEPS,
    FailedError,
    Lyapunov,
    SignFunction,
    change_along,
    half_the_bits,
    one_of,
    product,
    solved_in_bits,
)
from controller.riccati.rationals import states_without_cost
from trim.linear.frequency_response import hamiltonian, units_of

if TYPE_CHECKING:
    from flint import arb_mat

# These choose candidates only: the proof decides.

#: Exponents of entries of this size are left as they are.
MODERATE_EXPONENT = 12
#: Exponents of units that differ by more from those of a candidate need another one.
LARGEST_UNIT_CHANGE = 10
#: Exponents of units that differ by at most this much from those of a candidate are left.
SMALLEST_UNIT_CHANGE = 2
#: The states are changed until the least eigenvalue of |P| is at least this fraction of the
#: largest, at most so often. Each change gains the digits of doubles.
LEAST_RATIO, MOST_CHANGES = 1e-5, 4
#: A smaller fraction is not resolved by doubles, and after two changes it is that of P = 0.
UNRESOLVED = 1e-14
#: A relative correction of X that is far below its last digit in doubles, with 128 bits: with
#: twice the bits, its square.
SMALL_CORRECTION = 1e-25
#: A relative correction after which the loop is computed anew.
LARGE_CORRECTION = 1e-6
#: Largest number of states for which the matrix sign function is computed, which takes a second.
MOST_STATES_IN_BITS = 40


class Candidate(NamedTuple):
    """Candidate solution of a Riccati equation, which `stabilizing` judges.

    X: (n, n), its solution, balls or a `Pair` of one symmetric matrix
    gains, residual: at X, of which the residual may be `Near`
    loop: F of both players at X, (n, n), in balls, or `Near` if the proof is by doubles
    Y: (n, n), symmetric, of the kind of F: solution of F'Y + Y F = -1, in discrete time of
        F'Y F - Y = -1
    """

    equation: Equation
    X: Any
    gains: Any
    residual: Any
    loop: Any
    Y: Any

    @classmethod
    def at(cls, equation: Equation, X: arb_mat, Y: arb_mat) -> Candidate:
        """Return the candidate with the midpoints of the symmetric parts of X and Y, in balls.

        Raises FailedError.
        """
        with failures():
            X = symmetric(X)
            gains, residual = equation.gains_and_residual(X)
            return cls(equation, X, gains, residual, equation.loop(gains), symmetric(Y))

    @property
    def in_balls(self) -> Candidate:
        """The same candidate of a proof in doubles, whose proof is in balls.

        Raises FailedError.
        """
        return Candidate.at(self.equation, self.X, ball_matrix(self.Y.middle))


@contextmanager
def failures() -> Iterator[None]:
    """Raise FailedError where arithmetic fails."""
    with np.errstate(all="ignore"):
        try:
            yield
        except (np.linalg.LinAlgError, ValueError, ZeroDivisionError, OverflowError) as failure:
            raise FailedError(str(failure)) from None


def value_in_doubles(game: Game) -> np.ndarray:
    """Return P, (n, n), in doubles, which nothing corrects or proves.

    Raises FailedError.
    """
    with precision(BITS), failures():
        units = first_units(game, game.delta)
        X = stabilizing_in_doubles(Equation(game, units, game.delta))
        return np.ldexp(X, -np.add.outer(units.states, units.states))


def proposed(
    game: Game, delta: float, near: Units | None = None, most_changes: int = MOST_CHANGES
) -> tuple[Equation, np.ndarray]:
    """Return the equation in states in which P is near 1, and its solution X in doubles, (n, n).

    near: units and states where the search begins; by default those of the Hamiltonian
    most_changes: largest number of changes of the states

    Raises FailedError.
    """
    with failures():
        units = near or first_units(game, delta)
        equation = Equation(game, units, delta)
        X = stabilizing_in_doubles(equation)
        # Powers of two as units, in which the diagonal of |X| is near 1.
        for _ in range(0 if near else MOST_CHANGES):
            better, X_there = _in_units_of_solution(game, delta, units, X)
            change = np.abs(np.concatenate(better[:2]) - np.concatenate(units[:2])).max()
            if change <= SMALLEST_UNIT_CHANGE:
                break  # the units serve the proof as well
            units, X, equation = better, X_there, Equation(game, better, delta)
            if change <= LARGEST_UNIT_CHANGE:
                break  # in the former units, X had its digits already
            X = stabilizing_in_doubles(equation)
        # Other states, in which |X| itself is near 1.
        for changes_done in range(most_changes):
            # The first changes make small eigenvalues larger.
            noise = UNRESOLVED if changes_done > 1 else 0.0
            root = _root_of(X, game, noise)
            if root is None:
                break
            units = _times_root(units, root)
            equation = Equation(game, units, delta)
            X = stabilizing_in_doubles(equation)
        return equation, X


def _in_units_of_solution(
    game: Game, delta: float, units: Units, X: np.ndarray
) -> tuple[Units, np.ndarray]:
    """Return units in which the diagonal of |X| is nearly 1, and so are the weights of the inputs,
    R + B'P B; and X in these units.
    """
    sizes = np.where(states_without_cost(game), 1.0, sizes_of(X))
    steps = -_half_exponents(sizes)
    states = units.states + steps
    X = np.ldexp(X, np.add.outer(steps, steps))
    weight = _input_weights(game, np.ldexp(game.B, -states[:, None]), X)
    return Units(states, -_half_exponents(weight), disturbance_units(game, delta)), X


def sizes_of(X: np.ndarray) -> np.ndarray:
    """Return s with |X_ij|² <= s_i s_j, (n,): the diagonal of X, or of |X| if X is indefinite."""
    sizes = np.abs(np.diag(X))
    try:
        np.linalg.cholesky(X)
    except np.linalg.LinAlgError:
        if np.isfinite(X).all():
            values, vectors = np.linalg.eigh(X)
            sizes = np.maximum(sizes, vectors**2 @ np.abs(values))  # which loses small ones
    return sizes


def _root_of(X: np.ndarray, game: Game, noise: float) -> np.ndarray | None:
    """Return the root T of |X|, (n, n): in the states T z, |X| is 1. None if the eigenvalues of |X|
    are within `LEAST_RATIO` already, or if the least one may be 0.

    Eigenvalues that doubles do not resolve count as the largest one times eps. States without cost
    are left as they are.

    noise: eigenvalues up to this fraction of the largest may be 0
    """
    kept = np.flatnonzero(~states_without_cost(game))
    places = np.ix_(kept, kept)
    values, vectors = np.linalg.eigh(X[places])
    sizes = np.abs(values)
    largest, least = sizes.max(initial=0.0), sizes.min(initial=math.inf)
    if least >= LEAST_RATIO * largest or least <= noise * largest:
        return None
    root = np.eye(len(X))
    squares = np.maximum(sizes, np.finfo(float).eps * largest)
    root[places] = np.sqrt(squares)[:, None] * vectors.T
    return root


def _times_root(units: Units, root: np.ndarray) -> Units:
    """Return units with the states (root T) y in place of T y, in which X is nearly ±1.

    root: root'root is |X| in the states T y; T None is the identity
    """
    in_balls = ball_matrix(root)
    return units._replace(T=in_balls if units.T is None else (in_balls * units.T).mid())


def corrections(equation: Equation, X: Any) -> Iterator[Candidate]:
    """Yield candidates X + Z, each with one more correction Z, until the correction is small, the
    residual is that of rounding, or the correction is more than half of the one before it.

    Z solves F'Z + Z F + r = 0 in doubles, with the loop F at X. Only the residual r at X is
    computed with more digits: in pairs of doubles, or in balls if `precision` has more bits than
    `BITS`. That at X + Z is r plus a linear and a quadratic change (`Equation.changes`), in
    doubles: their rounding is that of numbers as small as Z.

    X: (n, n), symmetric, doubles or balls

    Raises FailedError.
    """
    has_no_cost, in_doubles = states_without_cost(equation.game), equation.in_doubles
    exact = equation.in_pairs if bits() == BITS else equation
    last, lyapunov, is_discrete = math.inf, None, equation.is_discrete
    one = Near(np.eye(equation.n))
    X = exact.kind(X if isinstance(X, np.ndarray) else symmetric(X))
    for _ in range(NEWTON_STEPS):
        with failures():
            gains, residual = exact.gains_and_residual(X)
            near_X, r = Near.of(X), Near.of(residual)
            F = Near.of(exact.loop(gains))  # where A and G k cancel, doubles lose digits
            if lyapunov is None:
                lyapunov, Y = Lyapunov(F.middle, is_discrete=is_discrete), one * 0.0
            # The defect of one solution Y in doubles may be large: it is corrected, too.
            defect = change_along(F, Y, is_discrete=is_discrete) + one
            form = Y.middle + lyapunov.solve(-defect.middle)
            correction = lyapunov.solve(-r.middle)
            correction[has_no_cost] = correction[:, has_no_cost] = 0.0
            # The proof is that of a symmetric Z and Y.
            correction, Y = (correction + correction.T) / 2.0, Near((form + form.T) / 2.0)
            size = np.abs(near_X.middle).max() or 1.0
            largest, Z = np.abs(correction).max() / size, Near(correction)
            of_gains, quadratic = in_doubles.changes(near_X, F, Z)
            at_Z = r + change_along(F, Z, is_discrete=is_discrete) + quadratic
            X, gains = X + exact.kind(Z), gains + exact.kind(of_gains)
            loop = F - in_doubles.G * of_gains
        if largest <= LARGE_CORRECTION:
            yield Candidate(equation, X, gains, at_Z, loop, Y)
        else:
            lyapunov = None
        is_small = largest <= SMALL_CORRECTION ** (bits() / BITS) or at_Z.size <= 2.0 * r.error
        if is_small or not largest < 0.5 * last:
            break
        X, last = X.mid(), largest
    if not largest <= LARGE_CORRECTION:
        raise FailedError("the corrections do not shrink")


def stabilizing_in_doubles(equation: Equation) -> np.ndarray:
    """Return the stabilizing X, (n, n), in doubles that nothing proves.

    Raises FailedError, LinAlgError or ValueError.
    """
    X = stable_subspace(half_plane_in_doubles(equation), equation.n)
    has_no_cost = states_without_cost(equation.game)
    X[has_no_cost] = X[:, has_no_cost] = 0.0
    return X


def stable_subspace(half_plane: Any, n: int) -> Any:
    """Return X, (n, n), symmetric, of the stable subspace [1; X] of a matrix M, (2n, 2n), by least
    squares: (1 + sign(M)) [1; X] = 0.

    Raises FailedError, LinAlgError, ValueError or ZeroDivisionError.
    """
    found: Any = SignFunction(half_plane)
    if found.stable != n:
        raise FailedError(f"there are {found.stable} stable eigenvalues instead of {n}")
    to_zero, every_row = found.sign + one_of(found.sign), slice(None)
    of_1, of_X = part(to_zero, every_row, slice(n)), part(to_zero, every_row, slice(n, None))
    if isinstance(to_zero, np.ndarray):
        basis, triangle = np.linalg.qr(of_X)
        X = -np.linalg.solve(triangle, basis.T @ of_1)
        if not np.isfinite(X).all():
            raise FailedError("the candidate is not finite")
        return (X + X.T) / 2.0
    square = product(of_X.transpose(), of_X)  # of the normal equations: there are digits enough
    return symmetric(-square.solve(product(of_X.transpose(), of_1)))


def half_plane_in_doubles(equation: Equation) -> np.ndarray:
    """Return the `half_plane_matrix` of an equation in doubles.

    Raises LinAlgError in discrete time if z = -1 is an eigenvalue.
    """
    if equation.is_discrete:
        return half_plane_of_steps(equation.n, *pencil_in_doubles(equation))
    return hamiltonian(*(block.middle for block in equation.in_doubles.blocks()))


def pencil_in_doubles(equation: Equation) -> list[np.ndarray]:
    """Return L and M of the pencil L - z M of an equation in discrete time in doubles."""
    return [near.middle for near in equation.in_doubles.pencil()]


def half_plane_of_steps(n: int, L: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return the block of states and costates of (L + M)⁻¹ (L - M), with the pencil L - z M."""
    # λ = (z - 1) / (z + 1) where L - z M is singular: the unit disk becomes the left half-plane.
    return np.linalg.solve(L + M, L - M)[: 2 * n, : 2 * n]


def first_units(game: Game, delta: float) -> Units:
    """Return units in which the Hamiltonian is balanced, or the user's if they are moderate."""
    matrices = game.A, game.B, game.E, game.Q, game.R
    entries = np.concatenate([matrix.ravel() for matrix in matrices])
    exponents = np.frexp(entries[entries != 0.0])[1]
    states, inputs = (np.zeros(size, dtype=int) for size in game.B.shape)
    if np.abs(exponents).max(initial=0) > MODERATE_EXPONENT:
        weight = _input_weights(game, game.B, game.Q)
        S = (game.B / np.where(weight > 0.0, weight, 1.0)) @ game.B.T + game.E @ game.E.T / delta**2
        states = np.log2(units_of(game.A, S, game.Q)).astype(int)
        inputs = -_half_exponents(weight)
    return Units(states, inputs, disturbance_units(game, delta))


def _input_weights(game: Game, B: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return the weight of each input, the diagonal of R, in discrete time of R + α B'X B, (m,)."""
    weight = np.diag(game.R).astype(float)
    if game.is_discrete:
        weight = weight + game.discount * np.einsum("ij,ij->j", B, X @ B)
    return weight


def disturbance_units(game: Game, delta: float) -> np.ndarray:
    """Return units of the disturbances, (k,) integers, in which δ is nearly 1."""
    exponent = math.frexp(delta)[1] if math.isfinite(delta) else 0
    return np.full(game.E.shape[1], -exponent)


def _half_exponents(values: np.ndarray) -> np.ndarray:
    """Return k with 2^k nearest to the root of each positive value, and 0 for others."""
    positive = np.where((values > 0.0) & np.isfinite(values), values, 1.0)
    return np.round(0.5 * np.log2(positive)).astype(int)


def candidate_in_bits(game: Game, delta: float) -> Candidate:
    """Return a candidate by the matrix sign function, with as many bits as `precision` gives, in
    states in which it is near 1.

    Raises FailedError.
    """
    if len(game.A) > MOST_STATES_IN_BITS:
        raise FailedError("the matrix sign function takes long")
    with failures():
        units = first_units(game, delta)
        equation = Equation(game, units, delta)
        X = _without_noise(stable_subspace(equation.half_plane_matrix(), equation.n), game)
        for _ in range(MOST_CHANGES):
            root = _root_of(midpoints(X), game, float(half_the_bits()))
            if root is None:
                break
            units = _times_root(units, root)
            inverse = ball_matrix(root).inv()
            X = _without_noise(inverse.transpose() * X * inverse, game)
        candidate = Candidate.at(Equation(game, units, delta), X, X)
        one, is_discrete = identity(len(game.A)), game.is_discrete
        return candidate._replace(Y=solved_in_bits(candidate.loop, one, is_discrete=is_discrete))


def _without_noise(X: arb_mat, game: Game) -> arb_mat:
    """Return the midpoints of the symmetric part of X, exact, with 0 for states without cost."""
    # P is exactly 0 for states that never move a state with a cost; their entries of X are noise.
    has_cost = ball_matrix(np.diag(1.0 * ~states_without_cost(game)))
    return (has_cost * symmetric(X) * has_cost).mid()
