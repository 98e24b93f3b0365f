"""The terms of the paper's update law, Eq. (46), the gains of Theorem 1, and the step that they ask for.

An implicit step is the proximal point of the residual powers of the law.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from controller.training_data.stack_equations import StackEquations

#: Residuals below this count as this in the curvature, which is infinite at 0.
CURVATURE_FLOOR = 1e-14
#: The smallest normal number: dividing 0 by it gives 0.
TINY = float(np.finfo(float).tiny)
#: Most Newton steps of one implicit step, and the relative step at which it has converged.
MOST_STEPS, SETTLED = 60, 1e-10


class Sample(NamedTuple):
    """σ̄_j = σ_j/n_j, (N, M), and ē_j = e_j/n_j, (N,)."""

    regressors: np.ndarray
    residuals: np.ndarray


def normaliser(regressors: np.ndarray, kind: str) -> np.ndarray:
    """n_j = 1 + σ'σ ("squared") or sqrt(1 + σ'σ) ("root"); the print does not tell which."""
    squared = 1.0 + (regressors**2).sum(axis=-1)
    return squared if kind == "squared" else np.sqrt(squared)


def bellman(
    gradient: np.ndarray,
    drifts: np.ndarray,
    costs: np.ndarray,
    S: np.ndarray,
    weights: np.ndarray,
    policy_weights: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """σ_j = ∂ψ_j (F_j + B û_j + E d̂_j) and e_j = W'σ_j + z'Qz + û'Rû - δ²d̂'d̂ (Eq. 32-33), (N, M) and (N,).

    The policies are those of the value `policy_weights`: B û + E d̂ = -½ S ∂ψ'W_p, and their cost is
    ¼ (∂ψ'W_p)' S (∂ψ'W_p). gradient: (N, M, n), ∂ψ_j. drifts: (N, n), F_j. costs: (N,), z'Qz.
    """
    value_gradient = policy_weights @ gradient
    pushed = value_gradient @ S
    regressors = (gradient @ (drifts - 0.5 * pushed)[..., None])[..., 0]
    return regressors, regressors @ weights + costs + 0.25 * (pushed * value_gradient).sum(axis=-1)


@dataclass(frozen=True, eq=False)
class RecordedStack:
    """The history terms of Eq. (46).

    kind: of the normaliser. frozen_weights: W of the policies û_j, d̂_j that were stored with the samples, or None
    when the policies are re-evaluated at the stored states with the current weights. The paper stores them; then
    the stack's fixed point is the value of the stored policies and not of the game.
    """

    equations: StackEquations
    kind: str
    frozen_weights: np.ndarray | None

    @cached_property
    def _costs(self) -> np.ndarray:
        """z'Qz, (N_h,)."""
        e = self.equations
        return np.sum((e.states @ e.Q) * e.states, axis=-1)

    @cached_property
    def _frozen(self) -> tuple[np.ndarray, np.ndarray]:
        """σ_j and the cost of the stored policies, both independent of the current weights."""
        e, policy = self.equations, self.frozen_weights
        assert policy is not None
        return bellman(e.gradient, e.drifts, self._costs, e.S, np.zeros(e.basis.size), policy)

    def raw(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """σ_j and e_j before normalisation."""
        e = self.equations
        if self.frozen_weights is None:
            return bellman(e.gradient, e.drifts, self._costs, e.S, weights, weights)
        regressors, costs = self._frozen
        return regressors, regressors @ weights + costs

    @cached_property
    def _frozen_sample(self) -> tuple[np.ndarray, np.ndarray]:
        """n_j and σ̄_j of the stored policies."""
        n = normaliser(self._frozen[0], self.kind)
        return n, self._frozen[0] / n[:, None]

    def at(self, weights: np.ndarray) -> Sample:
        """σ̄_j and ē_j at the current weights."""
        regressors, residuals = self.raw(weights)
        if self.frozen_weights is not None:
            n, normalised = self._frozen_sample
            return Sample(normalised, residuals / n)
        n = normaliser(regressors, self.kind)
        return Sample(regressors / n[:, None], residuals / n)


class TheoremGains(NamedTuple):
    """lambda_0: smallest eigenvalue of Σ. c1, c2, alpha1, alpha2: Eq. (48)-(49)."""

    lambda_0: float
    c1: float
    c2: float
    alpha1: float
    alpha2: float


def theorem_gains(
    regressors: np.ndarray, gamma: float, eta: float, theta: float, predefined_time: float
) -> TheoremGains:
    """c₁ = (2γλ₀)^(1-η/2), c₂ = N_h^(-η/2) (2γλ₀)^(1+η/2), α_i = π / (θ T η c_i), T = T_w/2 (Eq. 48-49).

    regressors: (N_h, M), σ̄_j; λ₀ = λ_min(Σ_j σ̄_j σ̄_j'). A stack of rank below M to rounding gives α = inf.
    """
    count = len(regressors)
    lambda_0 = float(np.linalg.svd(regressors, compute_uv=False)[-1] ** 2)
    c1 = _power(2.0 * gamma * lambda_0, 1.0 - eta / 2.0)
    c2 = count ** (-eta / 2.0) * _power(2.0 * gamma * lambda_0, 1.0 + eta / 2.0)
    rate = math.pi / (theta * 0.5 * predefined_time * eta)
    return TheoremGains(lambda_0, c1, c2, *(rate / c if c > 0.0 else math.inf for c in (c1, c2)))


def _power(base: float, exponent: float) -> float:
    """base^exponent, inf where it overflows, as everywhere in NumPy."""
    try:
        return math.pow(base, exponent)
    except OverflowError:
        return math.inf


def signed_powers(residuals: np.ndarray, alpha1: float, alpha2: float, eta: float) -> np.ndarray:
    """(α₁+1) sig^(1-η)(ē) + (α₂+1) sig^(1+η)(ē), sig^p(x) = |x|^p sign(x)."""
    magnitude = np.abs(residuals)
    low = magnitude ** (1.0 - eta)
    # |e|^(1+η) = |e|² / |e|^(1-η) costs no second power; at 0 both are 0.
    high = magnitude * magnitude / np.maximum(low, TINY)
    result: np.ndarray = np.copysign((alpha1 + 1.0) * low + (alpha2 + 1.0) * high, residuals)
    return result


def update_direction(sample: Sample, gamma: float, alpha1: float, alpha2: float, eta: float) -> np.ndarray:
    """The share of the given samples in W', Eq. (46): -γ Σ_j σ̄_j [(α₁+1) sig^(1-η)(ē_j) + (α₂+1) sig^(1+η)(ē_j)]."""
    return -gamma * (signed_powers(sample.residuals, alpha1, alpha2, eta) @ sample.regressors)


def curvatures(residuals: np.ndarray, alpha1: float, alpha2: float, eta: float, floor: float) -> np.ndarray:
    """d/dē of `signed_powers`, with |ē| kept above `floor` because the first power has no derivative at 0."""
    magnitude = np.maximum(np.abs(residuals), floor)
    result: np.ndarray = (alpha1 + 1.0) * (1.0 - eta) * magnitude**-eta + (alpha2 + 1.0) * (1.0 + eta) * magnitude**eta
    return result


def explicit_step_limit(sample: Sample, gamma: float, alpha1: float, alpha2: float, eta: float) -> float:
    """The largest stable step of explicit Euler on Eq. (46) at these weights: 2 / λ_max(γ Σ_j c_j σ̄_j σ̄_j'), s.

    c_j: `curvatures`. It shrinks to 0 as any residual approaches 0.
    """
    stiffness = curvatures(sample.residuals, alpha1, alpha2, eta, floor=TINY)
    with np.errstate(over="ignore"):
        fastest = gamma * float(np.linalg.norm(np.sqrt(stiffness)[:, None] * sample.regressors, 2)) ** 2
    return 2.0 / fastest if fastest > 0.0 else math.inf


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

    def tried(trial: np.ndarray) -> tuple[float, Sample]:
        sample = at(trial)
        magnitude = np.abs(sample.residuals)
        powers = (alpha1 + 1.0) * magnitude ** (2.0 - eta) / (2.0 - eta)
        powers = powers + (alpha2 + 1.0) * magnitude ** (2.0 + eta) / (2.0 + eta)
        return float(((trial - weights) ** 2).sum() / (2.0 * gamma * step) + powers.sum()), sample

    inertia = 1.0 / np.sqrt(gamma * step)
    current, (value, sample) = weights, tried(weights)
    for _ in range(MOST_STEPS):
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
        while (found := tried(current + fraction * direction))[0] > value and fraction > 1e-12:
            fraction *= 0.5
        if not found[0] <= value:
            return current
        current, (value, sample) = current + fraction * direction, found
        if fraction * np.linalg.norm(direction) <= SETTLED * (1.0 + np.linalg.norm(current)):
            return current
    return current
