"""Values, gains and costs of games with 60 digits and no code of the project."""

import mpmath as mp
import numpy as np
from scipy.linalg import block_diag

DIGITS = 60


def exact_solution(game):
    """Return the value P and the gain K of a game in continuous time, rounded to doubles."""
    with mp.workdps(DIGITS):
        P = _value(game, None)
        B, R, N = (mp.matrix(each.tolist()) for each in (game.B, game.R, game.N))
        K = R**-1 * (B.T * P + N.T)
        return tuple(np.array(each.tolist(), dtype=float) for each in (P, K))


def exact_suboptimality(game, K):
    """Return sup z'(P_K - P)z / z'P z for P > 0, where P_K is the value of the game with the input
    u = -K z and the worst disturbance.
    """
    with mp.workdps(DIGITS):
        optimum = _value(game, None)
        above = _value(game, _exact(K)) - optimum
        root_inverse = mp.cholesky(optimum) ** -1
        ratios = mp.eigsy(root_inverse * above * root_inverse.T, eigvals_only=True)
        return float(max(ratios))


def _value(game, K):
    """Return the value P, (n, n), of the game with u = -K z, or with the best input if K is None:
    in discrete time the limit of the values of many steps, and in continuous time that of the
    stable subspace of the Hamiltonian.
    """
    A, B, E, Q, R, N = map(_exact, (game.A, game.B, game.E, game.Q, game.R, game.N))
    if K is not None:
        A, Q = A - B @ K, Q - N @ K - K.T @ N.T + K.T @ R @ K
        # The input is a deviation from -K z without effect and with a cost: the best one is 0.
        B, R, N = 0 * B, _exact(np.eye(len(R))), 0 * N
    if np.isfinite(game.delta):  # the disturbance is a second player of the weight -delta²
        weight = -(mp.mpf(game.delta) ** 2) * _exact(np.eye(E.shape[1]))
        B, N, R = np.hstack([B, E]), np.hstack([N, 0 * E]), block_diag(R, weight)
    A, B, Q, R, N = (mp.matrix(each.tolist()) for each in (A, B, Q, R, N))
    if game.is_discrete:
        root = mp.sqrt(mp.mpf(game.discount))  # V is quadratic: discount V(z) is V(root z)
        return _value_of_steps(root * A, root * B, Q, R, N)
    return _value_of_flow(A, B, Q, R, N)


def _exact(matrix):
    """Return a matrix as an array of the exact numbers of mpmath."""
    return np.vectorize(mp.mpf, otypes="O")(matrix)


def _value_of_steps(A, B, Q, R, N):
    """Return the limit of the values of 1, 2, 3 ... steps: P₊ = Q + A'PA - L'(R + B'PB)⁻¹L with
    L = B'PA + N'.
    """
    P = mp.zeros(A.rows)
    while True:
        coupling = B.T * P * A + N.T
        after = Q + A.T * P * A - coupling.T * (R + B.T * P * B) ** -1 * coupling
        if mp.norm(after - P) <= mp.mpf(10) ** (-DIGITS + 8) * mp.norm(after):
            return after
        P = after


def _value_of_flow(A, B, Q, R, N):
    """Return the stabilizing solution P = Y X⁻¹ by the eigenvectors (X, Y) of the Hamiltonian with
    eigenvalues in the left half plane.
    """
    n = A.rows
    inverse = R**-1
    S, open_loop, cost = B * inverse * B.T, A - B * inverse * N.T, Q - N * inverse * N.T
    H = mp.zeros(2 * n)
    H[:n, :n], H[:n, n:], H[n:, :n], H[n:, n:] = open_loop, -S, -cost, -open_loop.T
    values, vectors = mp.eig(H)
    stable = [place for place, value in enumerate(values) if mp.re(value) < 0]
    assert len(stable) == n
    upper = mp.matrix([[vectors[i, j] for j in stable] for i in range(n)])
    lower = mp.matrix([[vectors[n + i, j] for j in stable] for i in range(n)])
    P = lower * upper**-1
    return mp.matrix([[mp.re(P[i, j] + P[j, i]) / 2 for j in range(n)] for i in range(n)])
