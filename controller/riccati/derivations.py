"""Solutions X of the Riccati equation of stacks of normal forms, by eigenvectors and by the matrix
sign function: fast; none is tested here."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.riccati.normal_form import NormalForm

#: Newton steps after the eigenvectors: two in double precision, one with twice the digits.
STEPS = 3
#: Newton steps for the matrix sign: 10 are usual, one more for each halving of |Re λ|.
SIGN_STEPS = 25
#: A step that changes the matrix sign by less, relative, leaves rounding alone.
SETTLED_SIGN = 1e-9
#: Below this change a factor c is 1 but for less than the change.
NEAR_SIGN = 1e-2


class FromEigenvectors(NamedTuple):
    """Solutions from the eigenvectors of the Hamiltonians of a stack; nan where they give none.

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
    condition = _norm(vectors) * _norm(_inverse(vectors))
    distance = np.abs(values.real).min(axis=1) / condition / _norm(form.hamiltonian)

    order = np.argsort(values.real, axis=1)[:, :n]
    rates = np.take_along_axis(values, order, axis=1)
    basis = np.take_along_axis(vectors, order[:, None, :], axis=2)
    V1 = basis[:, :n]
    inverse = _inverse(V1)
    X = (basis[:, n:] @ inverse).real
    X = (X + X.mT) / 2.0
    sums = rates[:, :, None] + rates[:, None, :]
    for step in range(STEPS):
        if step < STEPS - 1:
            half = X @ (form.A - form.S @ X / 2.0)
            residual = half + half.mT + form.Q
        else:
            residual = form.residual(X)
        Z = (inverse.mT @ ((V1.mT @ residual @ V1) / -sums) @ inverse).real
        X = X + (Z + Z.mT) / 2.0
    return FromEigenvectors(X, largest(Z) / largest(X), stable, distance)


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
        W = (W + _inverse(W)) / 2.0
        change = largest(W - last) / largest(W)
        if not (change > SETTLED_SIGN).any():
            break
        is_near = bool((change < NEAR_SIGN).all())
    columns = W + np.eye(2 * n)
    of_X = columns[:, :, n:]
    constant = -columns[:, :, :n]
    return _inverse(of_X.mT @ of_X) @ (of_X.mT @ constant)


def largest(matrices: np.ndarray) -> np.ndarray:
    """max |M_ij| of each matrix, (...)."""
    return np.asarray(np.abs(matrices).max(axis=(-2, -1)))


def _norm(matrices: np.ndarray) -> np.ndarray:
    """Frobenius norm of each, (N,)."""
    return np.asarray(np.linalg.norm(matrices, axis=(1, 2)))


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Inverses, (N, n, n); nan where a matrix is singular, which must not stop the others."""
    try:
        return np.linalg.inv(matrices)
    except np.linalg.LinAlgError:
        regular = np.linalg.slogdet(matrices)[0] != 0.0
        inverses = np.full_like(matrices, np.nan)
        inverses[regular] = np.linalg.inv(matrices[regular])
        return inverses
