"""Largest excess of a policy over the optimum, with 60 digits and no code of the project."""

import mpmath as mp
import numpy as np

DIGITS = 60


def excess(game, K):
    """Return sup z'(P_K - P)z / z'P z for P > 0, where P_K is the value of the game of K.

    In discrete time, a value is the limit of those of many steps, and in continuous time that of
    the stable subspace of the Hamiltonian.
    """
    with mp.workdps(DIGITS):
        return float(_excess(game, mp.matrix(K.tolist())))


def _excess(game, K):
    of_policy = _value(game, K)
    optimum = _value(game, None)
    root = mp.cholesky(optimum)
    inverse = root**-1
    ratios = mp.eigsy(inverse * (of_policy - optimum) * inverse.T, eigvals_only=True)
    return max(ratios)


def _value(game, K):
    """Return the value of the game for fixed K, or of the best input."""
    A, B, E, Q, R, N = (
        mp.matrix(each.tolist()) for each in (game.A, game.B, game.E, game.Q, game.R, game.N)
    )
    n, m, k = A.rows, B.cols, E.cols
    players, crossed = [], []
    if K is None:
        players += [B[:, j] for j in range(m)]
        crossed += [N[:, j] for j in range(m)]
    else:
        A, Q = A - B * K, Q - N * K - K.T * N.T + K.T * R * K
    if np.isfinite(game.delta):
        players += [E[:, j] for j in range(k)]
        crossed += [mp.zeros(n, 1)] * k
    size, first = len(players), m if K is None else 0
    if not size:
        players, crossed, size, first = [mp.zeros(n, 1)], [mp.zeros(n, 1)], 1, 0
    price = -(mp.mpf(game.delta) ** 2 if np.isfinite(game.delta) else 1) * mp.eye(size)
    for i in range(first):
        for j in range(first):
            price[i, j] = R[i, j]
    moved, cross = (
        mp.matrix([[column[i] for column in columns] for i in range(n)])
        for columns in (players, crossed)
    )
    root = mp.sqrt(mp.mpf(game.discount))
    if game.is_discrete:
        return _of_steps(root * A, root * moved, Q, price, cross)
    return _of_flow(A, moved, Q, price, cross)


def _of_steps(A, B, Q, R, N):
    """Return the limit of the values of 1, 2, 3 ... steps."""
    P = mp.zeros(A.rows)
    while True:
        priced = B.T * P * A + N.T
        after = Q + A.T * P * A - priced.T * (R + B.T * P * B) ** -1 * priced
        if mp.norm(after - P) <= mp.mpf(10) ** (-DIGITS + 8) * mp.norm(after):
            return after
        P = after


def _of_flow(A, B, Q, R, N):
    """Return the stabilizing solution by the eigenvectors of the Hamiltonian."""
    n = A.rows
    inverse = R**-1
    S, free, cost = B * inverse * B.T, A - B * inverse * N.T, Q - N * inverse * N.T
    H = mp.zeros(2 * n)
    H[:n, :n], H[:n, n:], H[n:, :n], H[n:, n:] = free, -S, -cost, -free.T
    values, vectors = mp.eig(H)
    stable = [place for place, value in enumerate(values) if mp.re(value) < 0]
    assert len(stable) == n
    upper = mp.matrix([[vectors[i, j] for j in stable] for i in range(n)])
    lower = mp.matrix([[vectors[n + i, j] for j in stable] for i in range(n)])
    P = lower * upper**-1
    return mp.matrix([[mp.re(P[i, j] + P[j, i]) / 2 for j in range(n)] for i in range(n)])
