"""The paper's critic learning in flight: a policy whose memory contains the weights of Eq. (46)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from controller.game.basis import Basis
from hfa_aircraft.waveform import Waveform
from hfa_flight.policies.policy import Measurements, Policy
from hfa_support.errors import BadInputError


@dataclass(frozen=True, eq=False, repr=False)
class CriticPolicy(Policy):
    """Policy û = -½ R⁻¹B' ∂ψ(z)'W with W' = p W'(46)(z, F) and F = A z + r(t).

    W'(46) is the update of Eq. (46). p = 1 during learning, and p = 0 when the weights are frozen.

    law: the `PublishedLaw`, with samples, gains, normalization and coordinates of Eq. (46). The
      memory contains W (M,) in the law's coordinates y = z / scales.
    forcing: r(t) = A x_d - x_d', (n,), or zero if the critic receives F = A z

    Raises BadInputError if the law re-evaluates the policies of the samples, which is not supported
    in flight.
    """

    law: Any
    forcing: Waveform

    def __post_init__(self) -> None:
        """Raise BadInputError if the law re-evaluates the policies of the samples."""
        if self.law.settings.stack_policies != "frozen":
            raise BadInputError(
                "the stack's policies are re-evaluated; a flight needs those stored with the"
                " samples"
            )

    def control(self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX) -> ca.SX:
        """Return the input -½ R⁻¹B' ∂ψ'W, (m,)."""
        value_gradient = (
            ca.mtimes(gradient(self.law.basis, measurements.error / self._scales).T, memory)
            / self._scales
        )
        return -0.5 * ca.mtimes(ca.DM(self.law.game.R_inverse_B_transposed), value_gradient)

    def memory_rate(
        self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX, applied: ca.SX
    ) -> ca.SX:
        """Return dW/dt of Eq. (46) times `held`, (M,).

        The samples of Eq. (46) are the current state and the recorded samples.

        memory: W, (M,)
        held: 1 during learning, 0 when the weights are frozen
        """
        s = self.law.settings
        alpha1, alpha2 = self.law.gains
        sigma, residual = self._current(t, measurements.error, memory)
        squared = 1.0 + ca.dot(sigma, sigma)
        n = squared if s.normalisation == "squared" else ca.sqrt(squared)
        push = self._stack(memory) + sigma / n * powers(residual / n, alpha1, alpha2, s.eta)
        return -s.gamma * held * push

    @cached_property
    def _stack(self) -> ca.Function:
        """Function W -> Σ_j σ̄_j [(α₁+1) sig^(1-η)(ē_j) + (α₂+1) sig^(1+η)(ē_j)]."""
        # The sum is over the recorded samples, and ē_j = σ̄_j'W + ē_j(0). The matrix products are
        # not expanded, because compiling 250 samples entry by entry would take minutes.
        stored = self.law.recorded(np.zeros(self.law.basis.size))
        regressors = ca.DM(stored.regressors)
        weights = ca.MX.sym("W", self.law.basis.size)
        residuals = ca.mtimes(regressors, weights) + ca.DM(stored.residuals)
        alpha1, alpha2 = self.law.gains
        push = ca.mtimes(regressors.T, powers(residuals, alpha1, alpha2, self.law.settings.eta))
        return ca.Function("stack", [weights], [push], {"never_inline": True})

    def _current(self, t: ca.SX, z: ca.SX, memory: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return the regressor σ, (M,), and Bellman residual e of the current state (Eq. 32-33)."""
        e = self.law.equations
        y = z / self._scales
        drift = (ca.mtimes(ca.DM(self.law.game.A), z) + self.forcing.at(t)) / self._scales
        jacobian = gradient(self.law.basis, y)
        value_gradient = ca.mtimes(jacobian.T, memory)
        pushed = ca.mtimes(ca.DM(self.law.S), value_gradient)
        sigma = ca.mtimes(jacobian, drift - 0.5 * pushed)
        return sigma, ca.dot(memory, sigma) + ca.bilin(ca.DM(e.Q), y, y) + 0.25 * ca.dot(
            value_gradient, pushed
        )

    @property
    def _scales(self) -> ca.DM:
        return ca.DM(self.law.equations.scales)


def gradient(basis: Basis, z: ca.SX) -> ca.SX:
    """Return ∂ψ/∂z, (M, n), as a CasADi expression.

    z: CasADi expression, (n,)
    """
    parts = ca.vertsplit(z)
    rows = []
    for exponents in basis.exponents:
        powers_ = [int(power) for power in exponents]
        rows.append(ca.horzcat(*[_derivative(parts, powers_, i) for i in range(basis.states)]))
    return ca.vertcat(*rows)


def _derivative(z: list[ca.SX], exponents: list[int], channel: int) -> ca.SX:
    """Return ∂/∂z_channel of the monomial Π z_i^exponents[i]."""
    if exponents[channel] == 0:
        return ca.SX(1, 1)
    value = ca.SX(exponents[channel])
    for i, power in enumerate(exponents):
        lowered = power - (i == channel)
        if lowered:
            value = value * z[i] ** lowered
    return value


def powers(residuals: Any, alpha1: float, alpha2: float, eta: float) -> Any:
    """Return a sum of signed powers of the residuals, entry by entry.

        (α₁+1) sig^(1-η)(ē) + (α₂+1) sig^(1+η)(ē),   sig^p(x) = |x|^p sign(x)

    residuals: ē, an SX or MX expression
    """
    magnitude = ca.fabs(residuals)
    low = magnitude ** (1.0 - eta)
    # |x|^(1+η) = |x|² / |x|^(1-η) costs no second power, which is most of the loop's time; at 0
    # both are 0.
    high = magnitude**2 / (low + np.finfo(float).tiny)
    return ca.sign(residuals) * ((alpha1 + 1.0) * low + (alpha2 + 1.0) * high)
