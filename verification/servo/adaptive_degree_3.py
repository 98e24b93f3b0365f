"""The adaptive law of SimVFA for actuators of order 2: output feedback of relative degree 3."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from verification.servo.adaptive_parts import A0, A1, A2, Filter, MemoryParts, Tuner, operated, product_rate
from verification.servo.adaptive_policy import AdaptivePolicy

#: Adaptation rates: of states, of the effectiveness, of the reference model's own inputs.
GAMMA_STATE, GAMMA_EFFECTIVENESS, GAMMA_MODEL = 0.2, 5000.0, 1000.0
#: States of the aircraft, with actuators, of the reference model; inputs; measured outputs.
_X, _XA, _N, _M, _Y = 6, 10, 12, 2, 3


class AdaptiveDegree3(AdaptivePolicy):
    """u = Π{Λ̂'v̄ - Ψ1'x_p - Ψ2'x̄1 - Ψ3'x̄2} - (α1 Ψ1' + α2 Ψ1'')' ε with derivatives of Ψ from tuners (`Tuner`),

        x_m' = (A - B K) x_m - [0; I] r + L e_y + F_e - F_ε,  ε' = the rows of L e_y that belong to the aircraft,
        F_e = B32 (Ψ4'ē1)' + B3 (α0 Ψ4'ē1 + Π{Ψ4'ē12} + Π{Ψ5'ē2}),
        F_ε = B32 (Λ̂2'ε̄1)' + B3 (α0 Λ̂2'ε̄1 + Π{Ψ6'ε̄12}),

    B3 = α2 B, B32 = α2 A B + α1 B, squared up in F_e; v̄ = -K x_m through 1/Π; x̄1, ē1 through (α2 s + α1)/Π, x̄2, ē2
    through α2/Π; ē12 of (Ψ4'ē1)' and ε̄12 of (Λ̂2'ε̄1)' through α2/Π, ε̄1 of (Ψ1'ε)' through (α2 s + α1)/Π; ē of R⁻¹S e_y.
    Source: Qu, Thomsen, Annaswamy 2018; Thomsen 2018, Section 4.1.2,
    regressors and rates as in the simulation released with them.
    """

    def law(self, memory: MemoryParts, tables: Sequence[ca.SX], measured: ca.SX, command: tuple[ca.SX, ca.SX]) -> ca.SX:
        """See the class."""
        A, B, K, L, S, R_inverse, squared_up = tables
        (r, r_rate), one = command, np.eye(_M)
        integrals, model = memory.take(_M), memory.take(_N)
        memory.move(integrals, measured[1:] - r)
        x = model.now
        off = ca.vertcat(measured[0], integrals.now) - ca.mtimes(ca.DM(self.models[0].C), x)
        mixed, v, pushed = ca.mtimes(S, off), -ca.mtimes(K, x), ca.mtimes(L, off)
        told, told_rate = (ca.vertcat(ca.SX.zeros(_XA), -each) for each in (r, r_rate))

        added = self._of_errors(memory, ca.mtimes(R_inverse, mixed), mixed, (A2 * squared_up, A))
        drift = memory.take(_X)
        memory.move(drift, pushed[:_X])
        x_rates = ca.mtimes(A, x) + told, ca.mtimes(A, ca.mtimes(A, x) + told - pushed) + told_rate
        artificial = x[:_X], x_rates[0][:_X], x_rates[1][:_X]
        psi_1 = Tuner(memory, _X, _M).drive(GAMMA_STATE, artificial[0], mixed[:_M])
        added -= self._of_drift(memory, psi_1, (drift.now, pushed[:_X]), mixed[:_M], (A2 * B, A))

        x_rate = x_rates[0] + pushed + ca.mtimes(B, v) + added
        memory.move(model, x_rate)
        slow = Filter(memory, _XA).drive(x[:_XA])
        x_1 = tuple(each[:_X] for each in slow.high(x_rate[:_XA]))
        psi_2 = Tuner(memory, _X, _M).drive(GAMMA_STATE, x_1[0], mixed[:_M])
        psi_3 = Tuner(memory, _XA, _M).drive(GAMMA_STATE, slow.low[0], mixed[:_M])
        v_bar = Filter(memory, _M).drive(v).plain
        effect = Tuner(memory, _M, _M, one).drive(-GAMMA_EFFECTIVENESS, v_bar[0], mixed[:_M])
        u = operated(effect, v_bar) - operated(psi_1, artificial)
        u -= operated(psi_2, x_1) + operated(psi_3, slow.low)
        return u - ca.mtimes((A2 * psi_1[2] + A1 * psi_1[1]).T, drift.now)

    @staticmethod
    def _of_errors(memory: MemoryParts, scaled: ca.SX, mixed: ca.SX, path: tuple[ca.SX, ca.SX]) -> ca.SX:
        """F_e."""
        bar, bar_12 = Filter(memory, _Y).drive(scaled), Filter(memory, _Y)
        psi_4, psi_5 = Tuner(memory, _Y, _Y), Tuner(memory, _Y, _Y)
        e_1 = bar.high()
        found_4 = psi_4.drive(GAMMA_MODEL, e_1[0] + bar_12.low_now, mixed)
        moved = product_rate(found_4, e_1)
        within = operated(found_4, bar_12.drive(moved).low)
        within += operated(psi_5.drive(GAMMA_MODEL, bar.low[0], mixed), bar.low)
        return _along(path, moved, A0 * ca.mtimes(found_4[0].T, e_1[0]) + within)

    @staticmethod
    def _of_drift(
        memory: MemoryParts, psi_1: Sequence[ca.SX], drift: Sequence[ca.SX], error: ca.SX, path: tuple[ca.SX, ca.SX]
    ) -> ca.SX:
        """F_ε."""
        bar_1 = Filter(memory, _M).drive(product_rate(psi_1, drift)).high()
        effect, bar_12 = memory.take(_M, _M, np.eye(_M)), Filter(memory, _M)
        effect_rate = -GAMMA_EFFECTIVENESS * ca.mtimes(bar_1[0], error.T)
        memory.move(effect, effect_rate)
        moved = product_rate((effect.now, effect_rate), bar_1)
        low = bar_12.drive(moved).low
        within = operated(Tuner(memory, _M, _M).drive(-GAMMA_MODEL, low[0], error), low)
        return _along(path, moved, A0 * ca.mtimes(effect.now.T, bar_1[0]) + within)


def _along(path: tuple[ca.SX, ca.SX], moved: ca.SX, still: ca.SX) -> ca.SX:
    """B32 moved + B3 still of path = (B3, A), B32 = A B3 + (α1 / α2) B3."""
    B3, A = path
    return ca.mtimes(A, ca.mtimes(B3, moved)) + ca.mtimes(B3, A1 / A2 * moved + still)
