"""The adaptive law of SimVFA for actuators of order 1: output feedback of relative degree 2."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import casadi as ca
import numpy as np

from controller.design.design_file import load_design
from controller.design.design_model import design_model
from controller.flight.commands import CommandSteps
from controller.flight.dihedral_table import DihedralTable
from controller.flight.flown_law import FlownLaw
from controller.flight.policies import Seen
from controller.flight.servo_policy import MeasuredOutputs
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, LINEAR_STATES
from trim.point.operating_point import OperatingPoint
from verification.servo.reference_model import ALPHAS, RATE, REGULATED, ReferenceModel, models_at, reference_model

DESIGN = "simvfa-1"
#: Adaptation rates: of the feedback of filtered states, of the effectiveness, of the reference model's own input.
GAMMA_STATE, GAMMA_EFFECTIVENESS, GAMMA_MODEL = 0.2, 2000.0, 400.0
_DIHEDRAL = LINEAR_STATES.index("dihedral")
#: States of the reference model without actuators, without integrals, in all; inputs; measured outputs.
_X, _XA, _N, _M, _Y = 6, 8, 10, 2, 3
#: Memory: integrals e, x_m, filtered x_m (without the integrals) and -K x_m, Ψ1, Ψ2, Λ̂, filtered error, Ψm.
_SIZES = (_M, _N, _XA, _M, _X * _M, _XA * _M, _M * _M, _Y, _Y * _Y)


@dataclass(frozen=True, eq=False)
class AdaptivePolicy:
    """u = Π{Λ̂'v̄ - Ψ1'x̄1 - Ψ2'x̄2},  Π = α0 + α1 d/dt,  with v = -K x_m and  α0 v̄ + α1 v̄' = α0 v,  x̄ from x_m alike,

        x_m' = (A - B K) x_m - [0; I] r + L e_y + B_s Π{Ψm'ē},   e_y = y - C x_m,   ē' = R⁻¹S e_y - (α0/α1) ē,
        Λ̂' = -Γ v̄ (S1 e_y)',  Ψ1' = Γ x̄1 (S1 e_y)',  Ψ2' = Γ x̄2 (S1 e_y)',  Ψm' = Γ ē (S e_y)'.

    x̄1: of the six states of the aircraft; x̄2: with the actuators. S1: the first two rows of S. B_s: the squared-up
    input matrix. All matrices are tabled over the measured dihedral. Source: Qu, Thomsen, Annaswamy 2018; regressors
    and rates as in the simulation released with it (Thomsen, SimVFA, 2018).
    """

    commands: CommandSteps
    outputs: MeasuredOutputs
    dihedral: float
    angles: np.ndarray
    models: Sequence[ReferenceModel]

    @property
    def memory_size(self) -> int:
        """Reference model, filters and adaptive parameters: 77 numbers."""
        return sum(_SIZES)

    @property
    def constants_size(self) -> int:
        """Nothing changes from tick to tick: 0."""
        return 0

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """u of the two inputs, 0 of the others."""
        u, _ = self._law(t, seen, memory)
        chosen = np.array([[float(name == one) for one in load_design(DESIGN).inputs] for name in INPUTS])
        return ca.mtimes(ca.DM(chosen), u)

    def memory_rate(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX, applied: ca.SX) -> ca.SX:
        """See the class."""
        return self._law(t, seen, memory)[1]

    def _law(self, t: ca.SX, seen: Seen, memory: ca.SX) -> tuple[ca.SX, ca.SX]:
        a0, a1 = ALPHAS[1]
        A, B, K, L, S, R_inverse, squared_up = self._table.at(self.dihedral + seen.states[_DIHEDRAL])
        e, model, filtered, v_bar, *flat, e_bar, psi = ca.vertsplit(memory, [0, *accumulate(_SIZES)])
        shapes = ((_X, _M), (_XA, _M), (_M, _M))
        psi_1, psi_2, effect = (ca.reshape(part, *shape) for part, shape in zip(flat, shapes, strict=True))
        measured, r = self.outputs.at(seen), self.commands.at(t)
        off = ca.vertcat(measured[0], e) - ca.mtimes(ca.DM(self.models[0].C), model)
        mixed = ca.mtimes(S, off)
        v = -ca.mtimes(K, model)
        v_rate, filtered_rate = a0 / a1 * (v - v_bar), a0 / a1 * (model[:_XA] - filtered)
        e_rate = ca.mtimes(R_inverse, mixed) - a0 / a1 * e_bar

        def pushed(gamma: float, regressor: ca.SX, error: ca.SX) -> ca.SX:
            return gamma * ca.mtimes(regressor, error.T)

        def operated(weights: ca.SX, weights_rate: ca.SX, regressor: ca.SX, regressor_rate: ca.SX) -> ca.SX:
            still, moving = ca.mtimes(weights.T, regressor), ca.mtimes(weights.T, regressor_rate)
            return a0 * still + a1 * (ca.mtimes(weights_rate.T, regressor) + moving)

        psi_1_rate = pushed(GAMMA_STATE, filtered[:_X], mixed[:_M])
        psi_2_rate = pushed(GAMMA_STATE, filtered, mixed[:_M])
        effect_rate = pushed(-GAMMA_EFFECTIVENESS, v_bar, mixed[:_M])
        psi = ca.reshape(psi, _Y, _Y)
        psi_rate = pushed(GAMMA_MODEL, e_bar, mixed)
        u = operated(effect, effect_rate, v_bar, v_rate)
        u -= operated(psi_1, psi_1_rate, filtered[:_X], filtered_rate[:_X])
        u -= operated(psi_2, psi_2_rate, filtered, filtered_rate)
        model_rate = ca.mtimes(A, model) + ca.mtimes(B, v) + ca.mtimes(L, off)
        model_rate += ca.mtimes(squared_up, operated(psi, psi_rate, e_bar, e_rate))
        model_rate[_XA:] -= r
        rates = (measured[1:] - r, model_rate, filtered_rate, v_rate)
        weights = (psi_1_rate, psi_2_rate, effect_rate)
        return u, ca.vertcat(*rates, *(ca.vec(each) for each in weights), e_rate, ca.vec(psi_rate))

    @cached_property
    def _table(self) -> DihedralTable:
        names = ("A", "B", "K", "L", "S", "R_inverse", "squared_up")
        return DihedralTable(self.angles, [np.array([getattr(each, name) for each in self.models]) for name in names])


def adaptive_law(aircraft: Aircraft, point: OperatingPoint, commands: CommandSteps, angles: np.ndarray) -> FlownLaw:
    """The law from its nominal parameters: Λ̂ = I, everything else 0. angles: of the tables, rad."""
    design = load_design(DESIGN)
    models = [reference_model(design_model(aircraft, model, design)) for model in models_at(aircraft, angles)]
    outputs = MeasuredOutputs(aircraft, point, (RATE, *REGULATED))
    policy = AdaptivePolicy(commands, outputs, point.states.dihedral, angles, models)
    start = [np.zeros(size) for size in _SIZES]
    start[_SIZES.index(_M * _M)] = np.eye(_M).ravel()
    fastest = max(float(np.abs(np.linalg.eigvals(each.A - each.L @ each.C)).max()) for each in models)
    return FlownLaw(
        "simvfa-1, adaptive", policy, np.zeros((1, 0)), np.concatenate(start), {"law": "adaptive"}, fastest=fastest
    )
