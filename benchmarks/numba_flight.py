"""The flight loop under numba."""

from __future__ import annotations

import numba
import numpy as np


def numba_flight(case, step: float, steps: int):
    """The loop as a compiled function () -> history."""
    data = case.data()
    arrays = tuple(
        np.ascontiguousarray(data[name], dtype=float)
        for name in ("A", "B", "RB", "scales", "S", "Q", "regressors", "residuals", "reference", "disturbance")
    )
    numbers = tuple(float(data[name]) for name in ("gamma", "alpha1", "alpha2", "eta"))
    return lambda: _flight(case.start, step, steps, arrays, numbers)


@numba.njit(cache=False)
def _powers(e, alpha1, alpha2, eta):
    size = abs(e)
    low = size ** (1 - eta)
    return np.sign(e) * ((alpha1 + 1) * low + (alpha2 + 1) * (size * size / (low + 2.2e-308)))


@numba.njit(cache=False)
def _rate(t, y, arrays, numbers, dy):
    A, B, RB, scales, S, Q, regressors, residuals, reference, disturbance = arrays
    gamma, alpha1, alpha2, eta = numbers
    x, w = y[:6], y[6:]
    z = x - (reference[0] + reference[1] * t + reference[2] * np.sin(0.5 * t))
    v = z / scales
    g = np.zeros(6)
    k = 0
    for i in range(6):
        for j in range(i, 6):
            g[i] += w[k] * v[j]
            g[j] += w[k] * v[i]
            k += 1
    for i, c in enumerate((0, 1, 3, 4)):
        g[c] += 4 * w[21 + i] * v[c] ** 3
    u = -0.5 * RB @ (g / scales)
    dy[:6] = A @ x + B @ u + disturbance[0] * np.sin(0.1 * t) + disturbance[1] * np.cos(0.1 * t)
    pushed = S @ g
    drift = A @ z / scales - 0.5 * pushed
    sigma = np.empty(25)
    k = 0
    for i in range(6):
        for j in range(i, 6):
            sigma[k] = v[j] * drift[i] + v[i] * drift[j]
            k += 1
    for i, c in enumerate((0, 1, 3, 4)):
        sigma[21 + i] = 4 * v[c] ** 3 * drift[c]
    e = w @ sigma + v @ (Q @ v) + 0.25 * (g @ pushed)
    n = np.sqrt(1 + sigma @ sigma)
    total = sigma / n * _powers(e / n, alpha1, alpha2, eta)
    for j in range(regressors.shape[0]):
        total += regressors[j] * _powers(regressors[j] @ w + residuals[j], alpha1, alpha2, eta)
    dy[6:] = -gamma * total


@numba.njit(cache=False)
def _flight(start, h, steps, arrays, numbers):
    size = start.size
    history = np.empty((steps + 1, size))
    history[0] = start
    k1, k2, k3, k4 = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    for step in range(steps):
        y, t = history[step], step * h
        _rate(t, y, arrays, numbers, k1)
        _rate(t + h / 2, y + h / 2 * k1, arrays, numbers, k2)
        _rate(t + h / 2, y + h / 2 * k2, arrays, numbers, k3)
        _rate(t + h, y + h * k3, arrays, numbers, k4)
        history[step + 1] = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return history
