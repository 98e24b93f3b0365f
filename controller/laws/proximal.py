"""One implicit step of the paper's update law: the proximal point of its residual powers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from controller.laws.published_equations import Sample, signed_powers

#: Residuals below this count as this in the curvature, which is infinite at 0.
CURVATURE_FLOOR = 1e-14
#: Most Newton steps of one implicit step, and the relative step at which it has converged.
MOST_STEPS, SETTLED = 60, 1e-10


def proximal_step(
    at: Callable[[np.ndarray], Sample],
    weights: np.ndarray,
    step: float,
    gamma: float,
    alpha1: float,
    alpha2: float,
    eta: float,
) -> np.ndarray:
    """argmin over W of |W - W_k|²/(2γh) + Σ_j (α₁+1)|ē_j|^(2-η)/(2-η) + (α₂+1)|ē_j|^(2+η)/(2+η).

    It is W' of Eq. (46) over the step h with the right side taken at the end of the step. Gauss-Newton with the
    curvature that bounds |ē|^(2-η) from above, and a backtracking line search. at: W -> Sample, with ∂ē/∂W = σ̄.
    Returns a vector with entries that are not finite when the powers overflow.
    """

    def objective(trial: np.ndarray) -> float:
        magnitude = np.abs(at(trial).residuals)
        powers = (alpha1 + 1.0) * magnitude ** (2.0 - eta) / (2.0 - eta)
        powers = powers + (alpha2 + 1.0) * magnitude ** (2.0 + eta) / (2.0 + eta)
        return float(np.sum((trial - weights) ** 2) / (2.0 * gamma * step) + np.sum(powers))

    inertia = 1.0 / np.sqrt(gamma * step)
    current, value = weights, objective(weights)
    for _ in range(MOST_STEPS):
        sample = at(current)
        push = signed_powers(sample.residuals, alpha1, alpha2, eta)
        magnitude = np.maximum(np.abs(sample.residuals), CURVATURE_FLOOR)
        root = np.sqrt((alpha1 + 1.0) * magnitude**-eta + (alpha2 + 1.0) * (1.0 + eta) * magnitude**eta)
        rows = np.vstack([root[:, None] * sample.regressors, inertia * np.eye(len(weights))])
        right = np.concatenate([-push / root, -inertia * (current - weights)])
        if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(right)) and np.isfinite(value)):
            return np.full_like(weights, np.nan)
        orthogonal, triangular = np.linalg.qr(rows)
        direction = np.linalg.solve(triangular, orthogonal.T @ right)
        fraction = 1.0
        while (lower := objective(current + fraction * direction)) > value and fraction > 1e-12:
            fraction *= 0.5
        if not lower <= value:
            return current
        current, value = current + fraction * direction, lower
        if fraction * np.linalg.norm(direction) <= SETTLED * (1.0 + np.linalg.norm(current)):
            return current
    return current
