"""Steady-state Kalman gain of a model in turbulence, and its derivatives by the unknowns.

Between samples the covariance P of the predicted states follows P⁺ = Φ P Φ' + Q, with
Φ = exp(A Δt) and Q = ∫ exp(A s) W exp(A s)' ds. At a sample P decreases by K C P, with

    S = C P C' + R,   K = P C' S⁻¹,   S = T D T'.

T is unit lower triangular, and D is diagonal. v = T⁻¹ (z - y) are the innovations of the measured
quantities, processed one after the other. The innovations are uncorrelated with variances D. W is
the power of the turbulence, and R is the diagonal covariance of the sensor noise.

Sources: R. V. Jategaonkar, *Flight Vehicle System Identification*, 2nd ed., 2015, chapter 5; B. D.
O. Anderson, International Journal of Control 28 (1978) 295-306 (doubling).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: Base-2 logarithm of the number of samples after which the gain is assumed to be steady.
_DOUBLINGS = 12
#: Number of halvings of the sampling interval; fast models need more.
_HALVINGS = 10
#: Step of finite differences, relative to the magnitudes of the unknowns.
_DIFFERENCE = 1e-5


@dataclass(frozen=True, eq=False)
class Gain:
    """Steady-state Kalman gain, with the covariance S = T D T' of the innovations.

    K: gain, (n, k), states by measured quantities
    whiten: T⁻¹, (k, k)
    variances: diagonal of D, (k,)
    """

    K: np.ndarray
    whiten: np.ndarray
    variances: np.ndarray


@dataclass(frozen=True, eq=False)
class GainSlopes:
    """Derivatives of a `Gain` with respect to the p unknowns.

    K: (n, k, p)
    whiten: (k, k, p)
    logarithms: derivatives of ln D, (k, p)
    """

    K: np.ndarray
    whiten: np.ndarray
    logarithms: np.ndarray


#: Unknowns (N, p) -> A (N, n, n), C (N, k, n), W (N, n, n) and R (N, k).
Matrices = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]


def gain_with_slopes(
    matrices: Matrices, theta: np.ndarray, sizes: np.ndarray, interval: float
) -> tuple[Gain, GainSlopes]:
    """Return the steady-state gain and its derivatives, computed with central differences.

    matrices: unknowns (N, p) -> A, C, W, R of N models
    theta: unknowns, (p,)
    sizes: typical magnitudes of the unknowns, (p,)
    interval: time between samples, s

    Raises FloatingPointError if the gain is not finite.
    """
    p = len(theta)
    moves = np.diag(_DIFFERENCE * sizes)
    rows = np.vstack([theta, theta + moves, theta - moves])
    with np.errstate(all="ignore"):  # results that are not finite raise an error
        try:
            K, whiten, variances = _steady(*matrices(rows), interval)
        except (np.linalg.LinAlgError, ValueError, OverflowError):
            raise FloatingPointError("the filter gain is not finite") from None
    if not (np.isfinite(K).all() and np.isfinite(variances).all() and (variances > 0.0).all()):
        raise FloatingPointError("the filter gain is not finite")

    def slopes(values: np.ndarray) -> np.ndarray:
        change = values[1 : p + 1] - values[p + 1 :]
        return np.moveaxis(change, 0, -1) / (2.0 * _DIFFERENCE * sizes)

    gain = Gain(K[0], whiten[0], variances[0])
    return gain, GainSlopes(slopes(K), slopes(whiten), slopes(np.log(variances)))


def _steady(
    A: np.ndarray, C: np.ndarray, W: np.ndarray, R: np.ndarray, interval: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K (N, n, k), T⁻¹ (N, k, k) and the diagonal of D (N, k) of N steady-state filters."""
    # R (N, k)
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
    """Return Φ and Q between two samples, (N, n, n) each, from series of third order."""
    # The series are evaluated over short intervals and composed.
    # A (N, n, n), W (N, n, n)
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
    """Return the predicted covariance P after 2^`_DOUBLINGS` samples from P = 0, (N, n, n)."""
    # The result is finite even if a drifting unobservable state has no steady covariance.
    # R (N, k)
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
