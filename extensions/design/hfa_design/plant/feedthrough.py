"""Removal of the feedthrough of a system without a change of whether its gain is below δ."""

from __future__ import annotations

import math

import numpy as np


def without_feedthrough(
    A: np.ndarray, E: np.ndarray, C: np.ndarray, D: np.ndarray, delta: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, E and Q = C'C of a system without feedthrough.

    The original system is x' = A x + E w, z = C x + D w. The gain of the returned system is below δ
    if and only if the gain of the original system is below δ. The gain of D alone must be below δ.
    """
    if not D.any() or math.isinf(delta):
        return A, E, C.T @ C
    free = np.eye(D.shape[1]) - D.T @ D / delta**2
    root = np.linalg.cholesky(free)
    Q = C.T @ np.linalg.solve(np.eye(len(D)) - D @ D.T / delta**2, C)
    return A + E @ np.linalg.solve(free, D.T @ C) / delta**2, np.linalg.solve(root, E.T).T, Q
