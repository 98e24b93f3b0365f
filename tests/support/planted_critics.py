"""Solutions of a game for tests with wrong critics: the exact one, and another Riccati root."""

from functools import cache

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from controller import basis
from hfa import solve


def weights_of(P):
    """Return the weights W of V = W' basis(z) = z'P z."""
    return basis("quadratic", len(P)).weights(P)


@cache
def solved(game):
    """Return the exact solution of a game, computed once."""
    return solve(game)


def value(game):
    """Return P of the exact solution."""
    return solved(game).P


def gain(game):
    """Return K of the exact solution."""
    return solved(game).K


def other_root(game):
    """Return a root P of the Riccati equation that does not stabilize, (n, n).

    Compared with the stabilizing root, one real closed-loop eigenvalue is reflected at the
    imaginary axis.
    """
    n = len(game.A)
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    values, vectors = np.linalg.eig(H)
    stable = [i for i in range(len(values)) if values[i].real < 0]
    real = min((i for i in stable if abs(values[i].imag) < 1e-9), key=lambda i: values[i].real)
    chosen = [int(np.argmin(np.abs(values + values[real]))) if i == real else i for i in stable]
    P = np.real(vectors[n:, chosen] @ np.linalg.inv(vectors[:n, chosen]))
    for _ in range(3):  # refines P to rounding errors
        P = (P + P.T) / 2
        residual = game.A.T @ P + P @ game.A + game.Q - P @ game.S @ P
        P = P + solve_continuous_lyapunov((game.A - game.S @ P).T, -residual)
    return (P + P.T) / 2
