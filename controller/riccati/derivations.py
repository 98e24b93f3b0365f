"""Fast solutions X of the Riccati equations of many normal forms, by eigenvectors and by doubling.

The solutions are not tested here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.riccati.balancing import hamiltonian, largest, norms
from controller.riccati.normal_form import NormalForm

#: Newton steps after the eigenvectors, with residuals in twice the precision.
STEPS = 3
#: Largest relative last Newton correction of an accepted solution. Above it, the Schur form is more
#: accurate.
SETTLED = 1e-12
#: If a correction exceeds this fraction of an entry, its rounding may change the entry.
NOTICED = 1e-2
#: Largest number of doublings; 5 to 10 are usual, and 45 are enough for a pole of 1e-12 times the
#: fastest.
DOUBLINGS = 50
#: The next doubling changes X by about the square of this E, relative.
SMALL = 1e-6
#: p, the cost of the final state, smaller than in most games in balanced units.
LAST = 2.0**-4


class FromEigenvectors(NamedTuple):
    """Candidate solutions X of N games from eigenvectors of the Hamiltonians, with data for their
    tests.

    X: (N, n, n), no solution unless `stable` is n, nan if V1 is singular (`by_eigenvectors`)
    correction: (N,), largest entry of the last Newton step, relative to the largest entry of X
    stable: (N,), number of eigenvalues of the Hamiltonian with a negative real part
    axis_distance: (N,), lower bound of `Spectrum.axis_distance` of the Hamiltonian
    eigenvalues: (N, 2n), eigenvalues of the Hamiltonian
    loop: (N, n), eigenvalues of A - S X
    spread: (N,), bound of the error of `loop` due to rounding of the eigenvectors
    eigenvectors: eigenvalues (N, n) and eigenvectors (N, n, n) of A - S X before the Newton steps,
        and the inverse of the eigenvectors
    """

    X: np.ndarray
    correction: np.ndarray
    stable: np.ndarray
    axis_distance: np.ndarray
    eigenvalues: np.ndarray
    loop: np.ndarray
    spread: np.ndarray
    eigenvectors: tuple[np.ndarray, np.ndarray, np.ndarray]


def by_eigenvectors(form: NormalForm) -> FromEigenvectors:
    """Return the solutions X of N games from the eigenvectors of their Hamiltonians, after Newton
    steps.

    [V1; V2] are the stable eigenvectors, and X = V2 V1⁻¹. V1 contains the eigenvectors of A - S X.
    V1⁻¹ (A - S X) V1 is therefore diagonal up to rounding. The condition number of all eigenvectors
    of a Hamiltonian bounds the distance of the Hamiltonian from the imaginary axis (Bauer and
    Fike). The eigenvectors of the other eigenvalues are [U; X U + (V1')⁻¹]. The rows of the inverse
    of the eigenvector matrix have the same norms as the columns of the matrix.
    Source: Zhou, Doyle and Glover, Section 13.2.
    """
    n = form.A.shape[-1]
    values, vectors = np.linalg.eig(form.hamiltonian)
    stable = (values.real < 0.0).sum(axis=1)

    order = np.argsort(values.real, axis=1)[:, :n]
    game = np.arange(len(order))[:, None]
    rates = values[game, order]
    basis = vectors.mT[game, order].mT
    V1 = basis[:, :n]
    inverse = inverses(V1)
    X = (basis[:, n:] @ inverse).real
    X = (X + X.mT) / 2.0
    sums = rates[:, :, None] + rates[:, None, :]
    correction = np.empty(len(X))
    rough: slice | np.ndarray = slice(None)
    part = form
    for _ in range(STEPS):
        left = V1[rough]
        right = inverse[rough]
        Z = (left.mT @ part.residual(X[rough]) @ left) / -sums[rough]
        Z = (right.mT @ Z @ right).real
        X[rough] += (Z + Z.mT) / 2.0
        size = largest(X)
        correction[rough] = largest(Z) / size[rough]
        least = np.diagonal(X, axis1=1, axis2=2).min(axis=1) / size
        rough = np.flatnonzero(correction > np.minimum(SETTLED, NOTICED * least))
        if not rough.size:
            break
        part = form[rough]
    nearly_diagonal = inverse @ (form.A - form.S @ X) @ V1
    loop = np.diagonal(nearly_diagonal, axis1=1, axis2=2)
    spread = norms(nearly_diagonal * (1.0 - np.eye(n)))
    U = V1 @ (inverse @ form.S @ inverse.mT / sums)
    condition = 2.0 * n**0.5 * np.hypot(norms(U), norms(X @ U + inverse.mT))
    distance = np.abs(values.real).min(axis=1) / condition / norms(form.hamiltonian)
    return FromEigenvectors(
        X, correction, stable, distance, values, loop, spread, (rates, V1, inverse)
    )


def by_doubling(form: NormalForm, eigenvalues: np.ndarray) -> np.ndarray:
    """Return the solutions X of N games, (N, n, n), by the structure-preserving doubling algorithm.

    X is the limit of the optimal costs over 2^k steps with the final cost p I, p = `LAST`.

    T = -2c [[A - S p - c I, -S], [-Q - p (A + A' - S p), -(A - S p - c I)']]^-1

    T defines a discrete-time game with E = I - T11, G = T12 and the cost X = T21 of one step. With
    V = (I + G X)^-1, each doubling replaces

    X <- X + E'X V E,
    G <- G + E V G E',
    E <- E V E

    until E is 0 up to rounding. The solution of the given game is p I + X. With p > 0, an unstable
    mode without a running cost has a final cost. c is slightly below the geometric mean of the
    largest and the smallest |λ|, because an eigenvalue may be at the mean itself. Source: Chu, Fan
    and Lin, Linear Algebra Appl. 396 (2005), 55-80.

    eigenvalues: λ of the Hamiltonians, (N, 2n), for the choice of c
    """
    n = form.A.shape[-1]
    one = np.eye(n)
    sizes = np.abs(eigenvalues)
    c = 0.9 * np.sqrt(sizes.max(axis=1) * sizes.min(axis=1))[:, None, None]
    A = form.A - LAST * form.S
    Q = form.Q + LAST * (A + form.A.mT)
    T = -2.0 * c * inverses(hamiltonian(A - c * one, form.S, Q))
    E = one - T[:, :n, :n]
    G = T[:, :n, n:]
    X = T[:, n:, :n]
    for _ in range(DOUBLINGS):
        V = inverses(one + G @ X)
        EV = E @ V
        X = X + E.mT @ (X @ V) @ E
        G = G + EV @ G @ E.mT
        E = EV @ E
        if not (np.abs(E) > SMALL).any():
            break
    return X + LAST * one


def inverses(matrices: np.ndarray) -> np.ndarray:
    """Return the inverse of each matrix, (..., n, n), with nan for a singular one."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        regular = np.linalg.slogdet(matrices)[0] != 0.0
        found = np.full_like(matrices, np.nan)
        found[regular] = np.linalg.inv(matrices[regular])
        return found
