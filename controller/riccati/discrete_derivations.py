"""Solutions X of the Riccati equation in discrete time of a normal form; none is tested here.

X = Q + A'X A - A'X G (W + G'X G)⁻¹ G'X A,  G = [B E],  W = blkdiag(I, -I)."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np

from controller.riccati.certificate import INDEFINITENESS
from controller.riccati.derivations import ROUNDING, largest
from controller.riccati.double_double import Pair, add, exact, product
from controller.riccati.normal_form import NormalForm
from hfa_support.errors import NoSolutionError

#: Newton steps after the Schur form.
REFINEMENTS = 8
#: Doublings of the horizon: 2^60 steps of time forget any start.
DOUBLINGS = 60
#: A correction of the doubling below this part of X is rounding.
SETTLED = 1e-17
#: Steps that refine an inverse to twice the digits, each of which squares its error.
INVERSIONS = 4


class NoValueError(NoSolutionError):
    """A proof, but for rounding, that a game has no value."""


class Policies(NamedTuple):
    """K of u = -K y, (m, n), and L of w = L y, (k, n), in normal form."""

    K: np.ndarray
    L: np.ndarray


def policies(form: NormalForm, X: np.ndarray) -> Policies:
    """[K; -L] = (W + G'X G)⁻¹ G'X A."""
    m = form.B.shape[1]
    G = np.hstack([form.B, form.E])
    W = np.diag(_signs(form))
    gains = np.linalg.solve(W + G.T @ X @ G, G.T @ X @ form.A)
    return Policies(gains[:m], -gains[m:])


def _signs(form: NormalForm) -> np.ndarray:
    """The diagonal of W, (m + k,)."""
    return np.repeat([1.0, -1.0], [form.B.shape[1], form.E.shape[1]])


class NewtonStep(NamedTuple):
    """Of X: `residual` + X = Q + K'K - L'L + F'X F, in which errors of K and L count by their
    squares only, and the correction Z = F'Z F + residual."""

    residual: np.ndarray
    correction: np.ndarray


def newton_step(form: NormalForm, X: np.ndarray) -> NewtonStep:
    """The step at X; its residual is computed with twice the digits, as that of `NormalForm`."""
    from scipy.linalg import solve_discrete_lyapunov

    gains = policies(form, X)
    G = np.hstack([form.B, form.E])
    both = np.vstack([gains.K, -gains.L])
    F = add(exact(form.A), product(exact(-G), exact(both)))
    paid = product(exact(both.T * _signs(form)), exact(both))
    total = add(add(exact(form.Q), exact(-X)), paid)
    total = add(total, product(_transposed(F), product(exact(X), F)))
    residual = np.asarray(total[0])
    with warnings.catch_warnings(action="ignore"):  # near the unit circle; the result is judged
        Z = solve_discrete_lyapunov(F[0].T, (residual + residual.T) / 2.0)
    return NewtonStep(residual, np.asarray(Z + Z.T) / 2.0)


def refined(form: NormalForm, X: np.ndarray) -> np.ndarray:
    """X after Newton steps, until they are rounding."""
    for _ in range(REFINEMENTS):
        correction = newton_step(form, X).correction
        X = X + correction
        if float(largest(correction)) <= ROUNDING * float(largest(X)):
            break
    return X


def by_symplectic_pencil(form: NormalForm) -> np.ndarray:
    """First derivation; 0 where nothing is paid for and A decays.

    Source: Arnold and Laub, Proc. IEEE 72 (1984), as implemented in SciPy."""
    from scipy.linalg import solve_discrete_are

    if not form.Q.any() and np.abs(np.linalg.eigvals(form.A)).max() < 1.0:
        return np.zeros_like(form.A)
    G = np.hstack([form.B, form.E])
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):
            X = solve_discrete_are(form.A, G, form.Q, np.diag(_signs(form)))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(
            "the symplectic pencil has no stable subspace that is the graph of a P"
        ) from error
    return np.asarray(X + X.T) / 2.0


def by_doubling(form: NormalForm) -> np.ndarray:
    """Second derivation: value iteration from 0, each pass of which doubles the horizon.

    M = (I + G H)⁻¹:  A <- A M A,  G <- G + A M G A',  H <- H + A'H M A, from A, S, Q; H is the
    value. Source: Chu, Fan, Lin and Wang, Int. J. Control 77 (2004), 767-788."""
    A = form.A
    G = form.S
    H = form.Q
    for _ in range(DOUBLINGS):
        M = np.linalg.inv(np.eye(len(A)) + G @ H)
        increase = A.T @ H @ M @ A
        G = G + A @ M @ G @ A.T
        H = H + (increase + increase.T) / 2.0
        A = A @ M @ A
        if not np.isfinite(H).all():
            raise NoSolutionError("value iteration grows without end")
        if largest(increase) <= SETTLED * largest(H):
            break
    return H


def by_precise_doubling(form: NormalForm) -> np.ndarray:
    """`by_doubling` with twice the digits, for inputs that cost nearly nothing: I + G H is then
    nearly singular.

    NoValueError where the value of a horizon is not above that of half of it, or the disturbance
    gains without bound within it."""
    n = len(form.A)
    A = exact(form.A)
    signed = exact(np.hstack([form.B, -form.E]))
    G = product(signed, exact(np.hstack([form.B, form.E]).T))
    H = exact(form.Q)
    for _ in range(DOUBLINGS):
        M = _inverse(add(exact(np.eye(n)), product(G, H)))
        MA = product(M, A)
        increase = product(_transposed(A), product(H, MA))
        G = add(G, product(product(product(A, M), G), _transposed(A)))
        H = add(H, increase)
        A = product(A, MA)
        if not np.isfinite(H[0]).all():
            raise NoSolutionError("value iteration grows without end")
        size = float(largest(H[0])) or 1.0
        is_lower = _least(increase[0]) < -INDEFINITENESS * size
        if is_lower or _least(np.eye(form.E.shape[1]) - form.E.T @ H[0] @ form.E) <= 0.0:
            raise NoValueError("over a finite horizon the game has no value")
        if largest(increase[0]) <= SETTLED * largest(H[0]):
            break
    return np.asarray(H[0] + H[0].T) / 2.0


def _inverse(matrix: Pair) -> Pair:
    """Z <- inv(Z M) Z from the inverse in double precision, which may have no digit right.

    Source: Rump, Inversion of extremely ill-conditioned matrices in floating-point, Japan J.
    Indust. Appl. Math. 26 (2009), 249-277."""
    n = len(matrix[0])
    last_bits = ROUNDING * np.cos(np.arange(n * n)).reshape(n, n)  # a singular one is so no more
    inverse = exact(np.linalg.inv(matrix[0] * (1.0 + last_bits)))
    for _ in range(INVERSIONS):
        nearly_one = product(inverse, matrix)[0]
        inverse = product(exact(np.linalg.inv(nearly_one)), inverse)
    return inverse


def _least(matrix: np.ndarray) -> float:
    """The smallest eigenvalue of the symmetric part; inf of a matrix without rows."""
    return float(np.linalg.eigvalsh((matrix + matrix.T) / 2.0).min(initial=np.inf))


def _transposed(pair: Pair) -> Pair:
    high, low = pair
    return high.T, low if np.ndim(low) == 0 else low.T
