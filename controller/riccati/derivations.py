"""Solutions X of the Riccati equation of stacks of normal forms, by eigenvectors and by the matrix
sign function: fast; none is tested here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.riccati.normal_form import NormalForm

#: Newton steps after the eigenvectors: one in double precision, the others with twice the digits.
STEPS = 3
#: The last of Newton's corrections that eigenvectors must reach, relative; above it the Schur form
#: has more digits.
SETTLED = 1e-12
#: Newton steps for the matrix sign: 10 are usual, one more for each halving of |Re λ|.
SIGN_STEPS = 25
#: A step that changes the matrix sign by less, relative, leaves rounding alone.
SETTLED_SIGN = 1e-7
#: Below this change a factor c is 1 but for less than the change.
NEAR_SIGN = 0.1


class FromEigenvectors(NamedTuple):
    """Solutions from the eigenvectors of the Hamiltonians of a stack, or nan where they give none.

    X: (N, n, n)
    correction: (N,), of the last Newton step, relative to X
    stable: (N,), number of eigenvalues of the Hamiltonian with a negative real part
    axis_distance: (N,), not above `Spectrum.axis_distance` of the Hamiltonian
    """

    X: np.ndarray
    correction: np.ndarray
    stable: np.ndarray
    axis_distance: np.ndarray


def by_eigenvectors(form: NormalForm) -> FromEigenvectors:
    """X = V2 V1⁻¹ of the stable eigenvectors [V1; V2] of each Hamiltonian, then Newton steps.

    V1 has the eigenvectors of A - S X, so that they solve the Lyapunov equation of a step too. The
    distance to the axis is bounded by the condition of all eigenvectors (Bauer and Fike).
    Source: Zhou, Doyle and Glover, Section 13.2."""
    n = form.A.shape[-1]
    values, vectors = np.linalg.eig(form.hamiltonian)
    stable = (values.real < 0.0).sum(axis=1)
    condition = norms(vectors) * norms(inverses(vectors))
    distance = np.abs(values.real).min(axis=1) / condition / norms(form.hamiltonian)

    order = np.argsort(values.real, axis=1)[:, :n]
    game = np.arange(len(order))[:, None]
    rates = values[game, order]
    basis = vectors.mT[game, order].mT
    V1 = basis[:, :n]
    inverse = inverses(V1)
    X = (basis[:, n:] @ inverse).real
    X = (X + X.mT) / 2.0
    sums = rates[:, :, None] + rates[:, None, :]
    for step in range(STEPS):
        if step == 0:
            half = X @ (form.A - form.S @ X / 2.0)
            residual = half + half.mT + form.Q
        else:
            residual = form.residual(X)
        Z = (inverse.mT @ ((V1.mT @ residual @ V1) / -sums) @ inverse).real
        X = X + (Z + Z.mT) / 2.0
        correction = largest(Z) / largest(X)
        if step > 0 and not (correction > SETTLED).any():
            break
    return FromEigenvectors(X, correction, stable, distance)


def by_sign(form: NormalForm, steps: int = SIGN_STEPS) -> np.ndarray:
    """X with (W + I) [I; X] = 0, W = sign(H) of each Hamiltonian, (N, n, n).

    H <- (c H + (c H)⁻¹) / 2 with c = |det H|^(-1/2n), until it settles: an error squares at each
    step. Source: Roberts, Int. J. Control 32 (1980), 677-687."""
    W = form.hamiltonian
    n = form.A.shape[-1]
    is_near = False
    for _ in range(steps):
        if not is_near:
            W = W * np.exp(-np.linalg.slogdet(W)[1] / (2 * n))[:, None, None]
        last = W
        W = (W + inverses(W)) / 2.0
        change = np.fmax.reduce(norms(W - last) / norms(W))  # where it is not nan
        if not change > SETTLED_SIGN:
            break
        is_near = change < NEAR_SIGN
    columns = W + np.eye(2 * n)
    of_X = columns[:, :, n:]
    constant = -columns[:, :, :n]
    return inverses(of_X.mT @ of_X) @ (of_X.mT @ constant)


def largest(matrices: np.ndarray) -> np.ndarray:
    """max |M_ij| of each matrix, (...)."""
    return np.asarray(np.abs(matrices).max(axis=(-2, -1)))


def norms(matrices: np.ndarray) -> np.ndarray:
    """Frobenius norm of each, (...)."""
    entries = matrices.reshape(*matrices.shape[:-2], -1)
    return np.sqrt(np.vecdot(entries, entries).real)


def inverses(matrices: np.ndarray) -> np.ndarray:
    """Inverses, (..., n, n), or nan where a matrix is singular, which must not stop the others."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        regular = np.linalg.slogdet(matrices)[0] != 0.0
        found = np.full_like(matrices, np.nan)
        found[regular] = np.linalg.inv(matrices[regular])
        return found
