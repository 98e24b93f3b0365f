"""The terms of the paper's update law, Eq. (46), the gains of Theorem 1, and the step that they ask for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from controller.samples.stack_equations import GAME, StackEquations


class Sample(NamedTuple):
    """σ̄_j = σ_j/n_j, (N, M), and ē_j = e_j/n_j, (N,)."""

    regressors: np.ndarray
    residuals: np.ndarray


def normaliser(regressors: np.ndarray, kind: str) -> np.ndarray:
    """n_j = 1 + σ'σ ("squared") or sqrt(1 + σ'σ) ("root"); the print does not tell which."""
    squared = 1.0 + np.sum(regressors**2, axis=-1)
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
    value_gradient = np.swapaxes(gradient, -1, -2) @ policy_weights
    pushed = value_gradient @ S
    regressors = (gradient @ (drifts - 0.5 * pushed)[..., None])[..., 0]
    return regressors, regressors @ weights + costs + 0.25 * np.sum(pushed * value_gradient, axis=-1)


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
        return bellman(e.gradient, e.drifts, self._costs, e.S(GAME), np.zeros(e.basis.size), policy)

    def raw(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """σ_j and e_j before normalisation."""
        e = self.equations
        if self.frozen_weights is None:
            return bellman(e.gradient, e.drifts, self._costs, e.S(GAME), weights, weights)
        regressors, costs = self._frozen
        return regressors, regressors @ weights + costs

    @cached_property
    def _frozen_normaliser(self) -> np.ndarray:
        return normaliser(self._frozen[0], self.kind)

    def at(self, weights: np.ndarray) -> Sample:
        """σ̄_j and ē_j at the current weights."""
        regressors, residuals = self.raw(weights)
        n = normaliser(regressors, self.kind) if self.frozen_weights is None else self._frozen_normaliser
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
    high = np.divide(magnitude * magnitude, low, out=np.zeros_like(low), where=low > 0.0)
    result: np.ndarray = np.sign(residuals) * ((alpha1 + 1.0) * low + (alpha2 + 1.0) * high)
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
    stiffness = curvatures(sample.residuals, alpha1, alpha2, eta, floor=np.finfo(float).tiny)
    with np.errstate(over="ignore"):
        fastest = gamma * float(np.linalg.norm(np.sqrt(stiffness)[:, None] * sample.regressors, 2)) ** 2
    return 2.0 / fastest if fastest > 0.0 else math.inf
