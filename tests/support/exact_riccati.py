"""The value of a game in continuous time by the eigenvectors of its Hamiltonian, with 60 digits."""

import mpmath
import numpy as np


def exact_solution(game):
    """Return P and K of a game without cross weights, rounded to doubles."""
    with mpmath.workdps(60):
        A, B, E, Q, R = (mpmath.matrix(getattr(game, name)) for name in "ABEQR")
        gain = mpmath.inverse(R) * B.T
        S = B * gain - E * E.T / mpmath.mpf(game.delta) ** 2
        n = A.rows
        H = mpmath.zeros(2 * n)
        H[:n, :n], H[:n, n:], H[n:, :n], H[n:, n:] = A, -S, -Q, -A.T
        values, vectors = mpmath.eig(H)
        stable = [column for column, value in enumerate(values) if value.real < 0]
        basis = mpmath.matrix([[vectors[row, column] for column in stable] for row in range(2 * n)])
        P = basis[n:, :] * mpmath.inverse(basis[:n, :])
        return tuple(
            np.array(each.apply(mpmath.re).tolist(), dtype=float) for each in (P, gain * P)
        )
