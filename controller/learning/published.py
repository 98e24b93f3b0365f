"""The critic update of the paper as printed: Eq. (46) with the gains of Theorem 1.

    W' = -γ Σ_j σ̄_j [(α₁+1) sig^(1-η)(ē_j) + (α₂+1) sig^(1+η)(ē_j)],   sig^p(x) = |x|^p sign(x)

The policies of W(0) are stored with the recorded samples. Therefore the residuals
ē_j = σ̄_j'W + c̄_j are linear in W. On the aircraft of the paper λ₀, the smallest eigenvalue of
Σ_j σ̄_j σ̄_j', is so small that the gains α₁ and α₂ require an integration step far below the
printed one, and the weights overflow.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from controller.learning.recording import Learned, Samples
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Settings of Section 5.1: predefined time T_w and integration step, s; η, γ and W(0).
T_W, STEP, ETA, GAMMA, FIRST_WEIGHT = 10.0, 1e-4, 0.8, 0.01, 100.0
#: θ, which the paper does not print.
THETA = 0.9
#: Number of steps from one report of the progress to the next.
STEPS_OF_A_REPORT = 100


class TheoremGains(NamedTuple):
    """Gains of Theorem 1, and the largest stable step of explicit Euler with them, at W(0).

    lambda_0: λ₀
    alpha1, alpha2: α₁ and α₂
    explicit_step_limit: s
    """

    lambda_0: float
    alpha1: float
    alpha2: float
    explicit_step_limit: float


class PublishedLaw(Samples):
    """Eq. (46) of the paper on the samples of a game.

        W' = -γ Σ_j σ̄_j [(α₁+1) sig^(1-η)(ē_j) + (α₂+1) sig^(1+η)(ē_j)],   ē_j = σ̄_j'W + c̄_j

    with sig^p(x) = |x|^p sign(x).
    """

    @cached_property
    def linear_residuals(self) -> tuple[np.ndarray, np.ndarray]:
        """σ̄_j = σ_j/n_j, (N_h, M), and c̄_j, (N_h,), with n = √(1 + σ'σ) (Eq. 32-33).

        With the stored policies, B û + E d̂ = -½ S ∂ψ'W(0), σ = ∂ψ (F + B û + E d̂), and the cost
        of the policies is ¼ (∂ψ'W(0))' S (∂ψ'W(0)).
        """
        slopes = FIRST_WEIGHT * self.gradient.sum(axis=1)  # ∂ψ'W(0)
        S_slopes = slopes @ self.game.S
        regressors = np.einsum("jmi,ji->jm", self.gradient, self.drifts - 0.5 * S_slopes)
        constants = self.costs + 0.25 * np.sum(S_slopes * slopes, axis=1)
        sizes = np.sqrt(1.0 + np.sum(regressors**2, axis=1))
        return regressors / sizes[:, None], constants / sizes

    @cached_property
    def gains(self) -> TheoremGains:
        """Gains of Theorem 1 (Eq. 48-49).

        c₁ = (2γλ₀)^(1-η/2), c₂ = N_h^(-η/2) (2γλ₀)^(1+η/2), α_i = π / (θ T η c_i), T = T_w/2
        """
        regressors, constants = self.linear_residuals
        lambda_0 = float(np.linalg.svd(regressors, compute_uv=False)[-1] ** 2)
        c1 = (2.0 * GAMMA * lambda_0) ** (1.0 - ETA / 2.0)
        c2 = len(regressors) ** (-ETA / 2.0) * (2.0 * GAMMA * lambda_0) ** (1.0 + ETA / 2.0)
        settling_rate = math.pi / (THETA * 0.5 * T_W * ETA)
        alpha1, alpha2 = (settling_rate / c if c > 0.0 else math.inf for c in (c1, c2))
        residuals = np.abs(FIRST_WEIGHT * regressors.sum(axis=1) + constants)
        slopes = (  # of the bracket of Eq. (46) with respect to ē_j
            (alpha1 + 1.0) * (1.0 - ETA) * residuals**-ETA
            + (alpha2 + 1.0) * (1.0 + ETA) * residuals**ETA
        )
        # The largest eigenvalue of -∂W'/∂W at W(0), 1/s. Euler steps above 2 / fastest diverge.
        fastest = GAMMA * float(np.linalg.norm(np.sqrt(slopes)[:, None] * regressors, 2)) ** 2
        return TheoremGains(lambda_0, alpha1, alpha2, 2.0 / fastest)

    def rate(self, weights: np.ndarray) -> np.ndarray:
        """Return W', the right side of Eq. (46), (M,)."""
        regressors, constants = self.linear_residuals
        residuals = regressors @ weights + constants
        sizes = np.abs(residuals)
        below_1 = (self.gains.alpha1 + 1.0) * sizes ** (1.0 - ETA)
        above_1 = (self.gains.alpha2 + 1.0) * sizes ** (1.0 + ETA)
        return np.asarray(-GAMMA * (np.copysign(below_1 + above_1, residuals) @ regressors))


def published_law(samples: Samples, progress: Progress | None) -> Learned:
    """Return the weights of Eq. (46) as printed, by explicit Euler, and the gains of Theorem 1.

    Raises NoSolutionError, with the step and the cause, if the weights overflow.
    """
    law = PublishedLaw(samples.game, samples.psi, samples.states)
    gains, weights = law.gains, np.full(law.psi.size, FIRST_WEIGHT)
    steps = round(T_W / STEP)
    for step in range(steps):
        if progress is not None and step % STEPS_OF_A_REPORT == 0:
            progress(step / steps, 1.0, f"t = {step * STEP:.3g} s")
        with np.errstate(all="ignore"):
            weights = weights + STEP * law.rate(weights)
        if not np.isfinite(weights).all():
            raise NoSolutionError(
                f"the law of Eq. (46) as printed overflows at step {step + 1} (t = "
                f"{(step + 1) * STEP:.3g} s): lambda_0 = {gains.lambda_0:.2g}, alpha1 = "
                f"{gains.alpha1:.2g} and alpha2 = {gains.alpha2:.2g} require an explicit step "
                f"below {gains.explicit_step_limit:.2g} s, the printed step is {STEP:g} s; "
                "leave out the law for one that solves the game"
            )
    return Learned(weights, law.residual(weights), gains._asdict())
