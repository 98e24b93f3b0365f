"""Steady Kalman gain of a model in turbulence, with its derivatives with respect to the unknowns.

Between samples the covariance of the predicted states follows P⁺ = Φ P Φ' + Q, Φ = exp(A Δt), Q = ∫
exp(A s) W exp(A s)' ds. At a sample it decreases by K C P, with

    S = C P C' + R,   K = P C' S⁻¹,   S = T D T'.

T is unit lower triangular and D diagonal. v = T⁻¹ (z - y) are the innovations of the measured
quantities, one after the other, uncorrelated and of variances D. W is the power of the turbulence
in the states that it moves, R the diagonal variance of the sensors.

Sources: R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., 2015, chapter 5; B. D.
O. Anderson, International Journal of Control 28 (1978) 295-306 (doubling).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Samples after which the gain is called steady, as a power of two.
_DOUBLINGS = 12
#: An interval between samples is halved so often, and more often where the model is fast.
_HALVINGS = 10
#: Part of an unknown's size by which derivatives by differences move it.
_DIFFERENCE = 1e-5


@dataclass(frozen=True, eq=False)
class Gain:
    """The steady gain of a filter.

    K: (n, k)
    whiten: (k, k), T⁻¹
    variances: (k,), the diagonal of D
    """

    K: np.ndarray
    whiten: np.ndarray
    variances: np.ndarray


@dataclass(frozen=True, eq=False)
class GainSlopes:
    """Derivatives of a gain with respect to the unknowns.

    K: (n, k, p)
    whiten: (k, k, p)
    logarithms: (k, p), derivatives of ln D
    """

    K: np.ndarray
    whiten: np.ndarray
    logarithms: np.ndarray


#: Unknowns (N, p) -> A (N, n, n), C (N, k, n), W (N, n, n) and R (N, k).
Matrices = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]


def gain_with_slopes(
    matrices: Matrices, theta: np.ndarray, sizes: np.ndarray, interval: float
) -> tuple[Gain, GainSlopes]:
    """Return the gain and its derivatives, by central differences.

    theta: (p,) unknowns
    sizes: (p,) their sizes
    interval: time between samples, s

    Raises FloatingPointError where the gain is not a number.
    """
    p = len(theta)
    moves = np.diag(_DIFFERENCE * sizes)
    rows = np.vstack([theta, theta + moves, theta - moves])
    with np.errstate(all="ignore"):  # what is not finite is refused
        try:
            K, whiten, variances = _steady(*matrices(rows), interval)
        except np.linalg.LinAlgError:
            raise FloatingPointError("the gain of the filter diverges") from None
    if not (np.isfinite(K).all() and np.isfinite(variances).all() and (variances > 0.0).all()):
        raise FloatingPointError("the gain of the filter diverges")

    def slopes(values: np.ndarray) -> np.ndarray:
        change = values[1 : p + 1] - values[p + 1 :]
        return np.moveaxis(change, 0, -1) / (2.0 * _DIFFERENCE * sizes)

    gain = Gain(K[0], whiten[0], variances[0])
    return gain, GainSlopes(slopes(K), slopes(whiten), slopes(np.log(variances)))


def _steady(
    A: np.ndarray, C: np.ndarray, W: np.ndarray, R: np.ndarray, interval: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K, T⁻¹ and the diagonal of D of N filters."""
    Phi, Q = _discrete(A, W, interval)
    P = _predicted_covariance(Phi, C, Q, R)
    P_C = P @ C.transpose(0, 2, 1)
    S = C @ P_C
    k = S.shape[1]
    S[:, range(k), range(k)] += R
    root = np.linalg.cholesky(S)
    deviations = np.diagonal(root, axis1=1, axis2=2)
    whiten = np.linalg.inv(root / deviations[:, None, :])
    K = np.linalg.solve(S, P_C.transpose(0, 2, 1)).transpose(0, 2, 1)
    return K, whiten, deviations**2


def _discrete(A: np.ndarray, W: np.ndarray, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Return Φ and Q between two samples, by doubling third-order series of a short interval."""
    norm = float(np.abs(A).sum(axis=2).max())
    doublings = _HALVINGS + max(0, math.ceil(math.log2(max(norm * interval, 1.0))))
    h = interval / 2.0**doublings
    n = A.shape[1]
    Ah = A * h
    Phi = np.eye(n) + Ah @ (np.eye(n) + Ah / 2.0 @ (np.eye(n) + Ah / 3.0))
    power = W * h
    first = Ah @ power
    second = Ah @ first + first @ Ah.transpose(0, 2, 1)
    Q = (
        power
        + (first + first.transpose(0, 2, 1)) / 2.0
        + (second + second.transpose(0, 2, 1)) / 6.0
    )
    for _ in range(doublings):
        Q = Q + Phi @ Q @ Phi.transpose(0, 2, 1)
        Phi = Phi @ Phi
    return Phi, Q


def _predicted_covariance(
    Phi: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray
) -> np.ndarray:
    """Return P after 2^12 samples from P = 0, by doubling. It also exists if an unobservable state
    drifts."""
    A = Phi.transpose(0, 2, 1)
    G = C.transpose(0, 2, 1) @ (C / R[:, :, None])
    H = Q
    identity = np.eye(Phi.shape[1])
    for _ in range(_DOUBLINGS):
        inner = np.linalg.solve(identity + G @ H, np.concatenate([A, G], axis=2))
        n = A.shape[2]
        by_A, by_G = inner[:, :, :n], inner[:, :, n:]
        H_next = H + A.transpose(0, 2, 1) @ H @ by_A
        G = G + A @ by_G @ A.transpose(0, 2, 1)
        A = A @ by_A
        H = 0.5 * (H_next + H_next.transpose(0, 2, 1))
        G = 0.5 * (G + G.transpose(0, 2, 1))
    return H
