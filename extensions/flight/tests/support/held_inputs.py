"""Motion and cost of a linear model while its inputs are held."""

import numpy as np
from scipy.linalg import block_diag, expm


def over_hold(A, B, Q, R, h):
    """Return A, B of a hold of h seconds, and Q, N, R of its exact cost by Gauss quadrature."""
    n, m = B.shape
    rates = np.block([[A, B], [np.zeros((m, n + m))]])
    weight = block_diag(Q, R)
    W = np.zeros((n + m, n + m))
    for node, share in zip(*np.polynomial.legendre.leggauss(20), strict=True):
        transition = expm(rates * 0.5 * h * (1.0 + node))
        W += 0.5 * h * share * (transition.T @ weight @ transition)
    end = expm(rates * h)
    return end[:n, :n], end[:n, n:], W[:n, :n], W[:n, n:], W[n:, n:]
