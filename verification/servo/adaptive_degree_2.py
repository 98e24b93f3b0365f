"""The adaptive law of SimVFA for actuators of order 1: output feedback of relative degree 2."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from verification.servo.adaptive_parts import MemoryParts, Part
from verification.servo.adaptive_policy import AdaptivePolicy
from verification.servo.reference_model import ALPHAS

#: Adaptation rates: of the feedback of filtered states, of the effectiveness, of the reference model's own input.
GAMMA_STATE, GAMMA_EFFECTIVENESS, GAMMA_MODEL = 0.2, 2000.0, 400.0
#: States of the aircraft, with actuators, of the reference model; inputs; measured outputs.
_X, _XA, _N, _M, _Y = 6, 8, 10, 2, 3
_A0, _A1 = ALPHAS[1]


class AdaptiveDegree2(AdaptivePolicy):
    """u = Π{Λ̂'v̄ - Ψ1'x̄1 - Ψ2'x̄2},  Π = α0 + α1 d/dt,  with v = -K x_m and  α0 v̄ + α1 v̄' = α0 v,  x̄ from x_m alike,

        x_m' = (A - B K) x_m - [0; I] r + L e_y + B_s Π{Ψm'ē},   e_y = y - C x_m,   ē' = R⁻¹S e_y - (α0/α1) ē,
        Λ̂' = -Γ v̄ (S1 e_y)',  Ψ1' = Γ x̄1 (S1 e_y)',  Ψ2' = Γ x̄2 (S1 e_y)',  Ψm' = Γ ē (S e_y)'.

    x̄1: of the six states of the aircraft; x̄2: with the actuators. S1: the first two rows of S. B_s: the squared-up
    input matrix. Source: Qu, Thomsen, Annaswamy 2018; regressors and rates as in the simulation released with it
    (Thomsen, SimVFA, 2018).
    """

    def law(self, memory: MemoryParts, tables: Sequence[ca.SX], measured: ca.SX, command: tuple[ca.SX, ca.SX]) -> ca.SX:
        """See the class."""
        A, B, K, L, S, R_inverse, squared_up = tables
        integrals, model, r = memory.take(_M), memory.take(_N), command[0]
        memory.move(integrals, measured[1:] - r)
        off = ca.vertcat(measured[0], integrals.now) - ca.mtimes(ca.DM(self.models[0].C), model.now)
        mixed, v = ca.mtimes(S, off), -ca.mtimes(K, model.now)

        def followed(size: int, x: ca.SX, gain: float) -> tuple[ca.SX, ca.SX]:
            """x through gain / (s + α0/α1), with its rate."""
            part = memory.take(size)
            rate = gain * x - _A0 / _A1 * part.now
            memory.move(part, rate)
            return part.now, rate

        def operated(weights: Part, gamma: float, regressor: tuple[ca.SX, ca.SX], error: ca.SX) -> ca.SX:
            """Π{Ψ'x} of weights with Ψ' = γ x e'."""
            rate = gamma * ca.mtimes(regressor[0], error.T)
            memory.move(weights, rate)
            slow = ca.mtimes(weights.now.T, regressor[1]) + ca.mtimes(rate.T, regressor[0])
            return _A0 * ca.mtimes(weights.now.T, regressor[0]) + _A1 * slow

        v_bar, x_bar = followed(_M, v, _A0 / _A1), followed(_XA, model.now[:_XA], _A0 / _A1)
        of_aircraft = x_bar[0][:_X], x_bar[1][:_X]
        u = operated(memory.take(_M, _M, np.eye(_M)), -GAMMA_EFFECTIVENESS, v_bar, mixed[:_M])
        u -= operated(memory.take(_X, _M), GAMMA_STATE, of_aircraft, mixed[:_M])
        u -= operated(memory.take(_XA, _M), GAMMA_STATE, x_bar, mixed[:_M])
        e_bar = followed(_Y, ca.mtimes(R_inverse, mixed), 1.0)
        added = ca.mtimes(squared_up, operated(memory.take(_Y, _Y), GAMMA_MODEL, e_bar, mixed))
        told = ca.vertcat(ca.SX.zeros(_XA), -r)
        memory.move(model, ca.mtimes(A, model.now) + ca.mtimes(B, v) + ca.mtimes(L, off) + told + added)
        return u
