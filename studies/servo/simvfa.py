"""The servo controllers of SimVFA: an LQR on the state of a reference model, and adaptive laws.

Sources: Qu, Thomsen, Annaswamy 2018; Thomsen 2018, Section 4.1. The regressors and adaptation
rates, for actuators of order 1 and 2, are those of the simulation released with these publications.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import casadi as ca
import numpy as np

import hfa
import hfa_model
from hfa import OperatingPoint, solve
from hfa.paper import level_model
from hfa_aircraft.model import Model
from hfa_design import load_design
from hfa_design.design import Design
from hfa_design.design_models import DesignModel, design_model
from hfa_flight import CommandSteps, ScheduledController
from hfa_flight.policies.controller import MatrixTables, MeasuredOutputs
from hfa_flight.policies.policy import Measurements, Policy
from hfa_flight.signals import COMMAND_FILTER
from hfa_model import INPUTS, LINEAR_STATES
from hfa_support.matrices import spectral_radius
from hfa_support.provenance import parameter_hash

#: Output that is measured besides the integrals, and regulated outputs.
RATE = "pitch_rate"
REGULATED = ("dihedral", "vertical_acceleration_short_period")
#: Coefficients of α0 + α1 s (+ α2 s²), by the order of the actuators.
ALPHAS = {1: (1.0, 0.5), 2: (2.0, np.sqrt(2.0), 1.0)}
#: Weights q I and r of the LQR that places the zeros of the squared-up plant; ε in R⁻¹; shift of A
#: in R⁻¹, 1/s.
SQUARING_Q = 1.0
SQUARING_R = 500.0
EPSILON = 20.0
SHIFT = 0.25
_THIRD = np.array([1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class ReferenceModel:
    """Reference model x_m' = A x_m + B u - [0; I] r + L (y - C x_m) with u = -K x_m (Qu 2018).

    The measured output is y = [pitch rate; integrals], and r are the commands. B1 (n, 3) is the
    squared-up input path of relative degree 1.

    A: (n, n)
    B: (n, 2)
    C: (3, n)
    K: (2, n)
    L: L = B1 R⁻¹ S, (n, 3)
    S: (3, 3), for which S C B1 is symmetric and positive definite
    R_inverse: (3, 3)
    squared_up: B with a third column that squares up the plant, (n, 3)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    K: np.ndarray
    L: np.ndarray
    S: np.ndarray
    R_inverse: np.ndarray
    squared_up: np.ndarray


def reference_model(built: DesignModel) -> ReferenceModel:
    """Return the reference model for the design model `simvfa-1` or `simvfa-2`.

        R⁻¹ = (S C B1)⁻¹ [S C (A + σ I) B1 + its transpose] (S C B1)⁻¹ + ε I

    σ is `SHIFT`, and ε is `EPSILON`.
    Sources: Qu, Thomsen, Annaswamy 2018; Thomsen 2018, Section 4.1.
    """
    from scipy.linalg import polar

    order = built.design.actuators[built.inputs[0]].order
    game = built.game()
    n = len(game.A)
    C = np.vstack([np.eye(n)[built.states.index(RATE)], np.eye(n)[n - 2 :]])
    squared_up = np.vstack([game.B.T, _third_row(game.A.T, C.T, game.B.T)]).T
    B1 = sum(
        a * np.linalg.matrix_power(game.A, k) @ squared_up for k, a in enumerate(ALPHAS[order])
    )
    S = polar(C @ B1)[0].T
    if (
        S[2].sum() < 0.0
    ):  # the sign of the third input is arbitrary, but must be equal in all tables
        squared_up = squared_up * _THIRD
        B1 = B1 * _THIRD
        S = S * _THIRD[:, None]
    mixed = S @ C
    inverse = np.linalg.inv(mixed @ B1)
    rate = mixed @ (game.A + SHIFT * np.eye(n)) @ B1
    R_inverse = inverse @ (rate + rate.T) @ inverse + EPSILON * np.eye(len(C))
    K = solve(game).K
    return ReferenceModel(game.A, game.B, C, K, B1 @ R_inverse @ S, S, R_inverse, squared_up)


def _third_row(A: np.ndarray, B: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return an output row c, (n,), with which (A, B, [C; c]) is square with stable zeros."""
    # The relative degree is unchanged. With T = [B⁺; N'] and N'B = 0, the part of T z that no input
    # drives directly is a smaller plant with the same outputs. If C B has full rank for the smaller
    # plant, c is the gain of an LQR and the zeros are the closed-loop eigenvalues. Otherwise the
    # reduction is repeated. Source: Qu, Wiese, Annaswamy, Lavretsky, Squaring-up in the presence of
    # transmission zeros, 2014.
    from scipy.linalg import null_space, solve_continuous_are

    m = B.shape[1]
    p = len(C)
    T = np.vstack([np.linalg.pinv(B), null_space(B.T).T])
    moved = T @ A @ np.linalg.inv(T)
    seen = C @ np.linalg.inv(T)
    A21 = moved[m:, :m]
    A22 = moved[m:, m:]
    C1 = seen[:, :m]
    C2 = seen[:, m:]
    if np.abs(C1).max() <= 1e-9 * np.abs(C2).max():
        row = np.concatenate([np.zeros(m), _third_row(A22, A21, C2)])
        return row @ T
    whole = np.vstack([C1, null_space(C1).T])
    pseudo = A21 @ np.linalg.inv(whole)
    drift = A22 - pseudo[:, :p] @ C2
    b = pseudo[:, p:]
    R = SQUARING_R * np.eye(m - p)
    P = solve_continuous_are(drift, b, SQUARING_Q * np.eye(len(drift)), R)
    gain = np.linalg.solve(R, b.T @ P)
    return np.concatenate([whole[p], gain[0]]) @ T


def simvfa_design(name: str) -> Design:
    """Return SimVFA's design for actuators of order 1 ("simvfa-1") or 2 ("simvfa-2")."""
    return replace(
        load_design(str(Path(__file__).parent / "designs" / f"{name}.toml"), hfa.aircraft()),
        name=name,
    )


def reference_servo(aircraft: Model, design: str, dihedrals: np.ndarray) -> ScheduledController:
    """Return SimVFA's LQR with its reference model, scheduled over the dihedral angle in rad.

    design: "simvfa-1" or "simvfa-2"
    dihedrals: breakpoints, rad

    The controller's state is x = [e; x_m]. The integrals e obey e' = z - r for the regulated
    outputs z. The reference model is corrected by [pitch rate; e].
    """
    chosen = simvfa_design(design)
    built = [
        design_model(aircraft, level_model(aircraft, dihedral), chosen)
        for dihedral in dihedrals.tolist()
    ]
    tables = [reference_model(each) for each in built]
    n = len(tables[0].A)
    shape = (len(tables), n + 2)
    A = np.zeros((*shape, n + 2))
    B = np.zeros((*shape, 5))
    C = np.zeros((len(tables), 2, n + 2))
    for k, each in enumerate(tables):
        A[k, 2:, 2:] = each.A - each.B @ each.K - each.L @ each.C
        A[k, 2:, :2] = each.L[:, 1:]
        B[k, 2:, 0] = each.L[:, 0]
        B[k, :2, 1:3] = np.eye(2)
        B[k, :2, 3:] = -np.eye(2)
        B[k, n:, 3:] = -np.eye(2)
        C[k, :, 2:] = -each.K
    points = [each.model.point for each in built]
    return ScheduledController(
        name=f"{design}, reference model",
        feedback="output",
        breakpoints=dihedrals,
        A=A,
        B=B,
        C=C,
        D=np.zeros((len(tables), 2, 5)),
        W=np.zeros((*shape, 2)),
        states=(
            *(f"{name}_integral" for name in REGULATED),
            *(f"model_{name}" for name in built[0].states),
        ),
        measurements=(RATE, *REGULATED),
        commands=tuple(f"{name}_command" for name in REGULATED),
        inputs=chosen.inputs,
        trim_states=np.array([point.states for point in points]),
        trim_inputs=np.array([point.inputs for point in points]),
        dynamics=hfa_model.variant_of(aircraft).name,
        parameters=parameter_hash(hfa_model.parameters_of(aircraft)),
        command_filter=COMMAND_FILTER,
        about={"design": design, "source": "Qu, Thomsen, Annaswamy 2018"},
        model=hfa.aircraft(),
    )


#: Factor μ on the squared regressor in the normalization of a tuner.
MU = 0.02
#: α0, α1, α2 of Π = α0 + α1 d/dt + α2 d²/dt², for actuators of order 2.
A0, A1, A2 = ALPHAS[2]
#: Adaptation rates: of the states; of the effectiveness, by order; of the reference model's inputs,
#: by order.
GAMMA_STATE = 0.2
GAMMA_EFFECTIVENESS = {1: 2000.0, 2: 5000.0}
GAMMA_MODEL = {1: 400.0, 2: 1000.0}
#: Numbers of aircraft states, inputs and measured outputs, and of states with actuators by order.
_X = 6
_M = 2
_Y = 3
_XA = {1: 8, 2: 10}
_DIHEDRAL = LINEAR_STATES.index("dihedral")
_TABLED = ("A", "B", "K", "L", "S", "R_inverse", "squared_up")


class Part(NamedTuple):
    """A part of a policy's memory.

    place: number of the part
    now: current value of the part
    """

    place: int
    now: ca.SX


class MemoryParts:
    """Division of a policy's memory into parts, each with an initial value and a time derivative.

    memory: the memory, or None if only the initial values are needed
    """

    def __init__(self, memory: ca.SX | None = None) -> None:
        self._memory = memory
        self._begin = 0
        self._starts: list[np.ndarray] = []
        self._rates: dict[int, ca.SX] = {}

    def take(self, rows: int, columns: int = 1, start: np.ndarray | None = None) -> Part:
        """Return the next part of the memory as a matrix (rows, columns).

        start: initial value, or None for 0
        """
        size = rows * columns
        self._starts.append(np.zeros(size) if start is None else start.ravel(order="F"))
        flat = (
            ca.SX.zeros(size)
            if self._memory is None
            else self._memory[self._begin : self._begin + size]
        )
        self._begin += size
        return Part(len(self._starts) - 1, ca.reshape(flat, rows, columns))

    def move(self, part: Part, rate: ca.SX) -> None:
        """Set the time derivative of a part."""
        self._rates[part.place] = ca.vec(rate)

    @property
    def rate(self) -> ca.SX:
        """Time derivative of the complete memory."""
        return ca.vertcat(*(self._rates[place] for place in range(len(self._starts))))

    @property
    def start(self) -> np.ndarray:
        """Initial value of the complete memory."""
        return np.concatenate(self._starts)


class Filter:
    """Filter α2 ξ'' + α1 ξ' + α0 ξ = x of an input x, with denominator Π = α2 s² + α1 s + α0."""

    def __init__(self, memory: MemoryParts, size: int) -> None:
        self._memory = memory
        self._parts = (memory.take(size), memory.take(size))

    @property
    def low_now(self) -> ca.SX:
        """Output (α2 / Π) x. It depends only on the filter's state, not on the current x."""
        return A2 * self._parts[0].now

    def drive(self, x: ca.SX) -> Filter:
        """Set the input x and return the filter."""
        xi, xi_rate = self._parts
        bend = (x - A0 * xi.now - A1 * xi_rate.now) / A2
        self._memory.move(xi, xi_rate.now)
        self._memory.move(xi_rate, bend)
        self.plain = xi.now, xi_rate.now, bend
        return self

    @property
    def low(self) -> tuple[ca.SX, ...]:
        """The output (α2 / Π) x and its first two derivatives."""
        return tuple(A2 * each for each in self.plain)

    def high(self, x_rate: ca.SX | None = None) -> tuple[ca.SX, ...]:
        """Return the output ((α2 s + α1) / Π) x and its derivatives.

        The first derivative is returned, and the second one if x' is given.

        x_rate: x', or None
        """
        xi, xi_rate, bend = self.plain
        found = A1 * xi + A2 * xi_rate, A1 * xi_rate + A2 * bend
        return found if x_rate is None else (*found, x_rate - A0 * xi_rate)


class Tuner:
    """Tuner Ψ = α0 g X with α2 X'' = Φ - g (α0 X + α1 X') and Φ' = γ ν e'.

    The normalization is g = 1 + μ ν'ν. ν is the regressor, e the error and γ the adaptation rate.
    """

    def __init__(
        self, memory: MemoryParts, rows: int, columns: int, start: np.ndarray | None = None
    ) -> None:
        begun = None if start is None else start / A0
        self._memory = memory
        self._goal = memory.take(rows, columns, start)
        self._X = memory.take(rows, columns, begun)
        self._X_rate = memory.take(rows, columns)

    def drive(self, gamma: float, regressor: ca.SX, error: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Set the regressor ν and the error e, and return Ψ with its first two derivatives.

        The change of g is neglected in the derivatives.

        gamma: adaptation rate γ
        regressor: ν
        error: e
        """
        g = 1 + MU * ca.dot(regressor, regressor)
        X = self._X.now
        X_rate = self._X_rate.now
        bend = (self._goal.now - g * (A0 * X + A1 * X_rate)) / A2
        self._memory.move(self._goal, gamma * ca.mtimes(regressor, error.T))
        self._memory.move(self._X, X_rate)
        self._memory.move(self._X_rate, bend)
        return A0 * g * X, A0 * g * X_rate, A0 * g * bend


def product_rate(psi: Sequence[ca.SX], x: Sequence[ca.SX]) -> ca.SX:
    """Return the derivative (Ψ'x)' of a product.

    psi, x: a matrix and a vector, each with its first derivative
    """
    return ca.mtimes(psi[1].T, x[0]) + ca.mtimes(psi[0].T, x[1])


def operated(psi: Sequence[ca.SX], x: Sequence[ca.SX]) -> ca.SX:
    """Return Π{Ψ'x} = α2 (Ψ'x)'' + α1 (Ψ'x)' + α0 Ψ'x.

    psi, x: a matrix and a vector, each with its first two derivatives
    """
    second = ca.mtimes(psi[2].T, x[0]) + 2 * ca.mtimes(psi[1].T, x[1]) + ca.mtimes(psi[0].T, x[2])
    return A2 * second + A1 * product_rate(psi, x) + A0 * ca.mtimes(psi[0].T, x[0])


@dataclass(frozen=True, eq=False, repr=False)
class AdaptivePolicy(Policy, ABC):
    """Adaptive law with a reference model, scheduled over the measured dihedral angle.

    commands: commands of the regulated outputs
    outputs: the measured pitch rate and regulated outputs
    dihedral: dihedral angle of the trim at which the flight begins, rad
    angles: dihedral angles of `models`, (N,), rad
    models: reference models to interpolate
    inputs: names of the controlled inputs
    """

    commands: CommandSteps
    outputs: MeasuredOutputs
    dihedral: float
    angles: np.ndarray
    models: Sequence[ReferenceModel]
    inputs: tuple[str, ...]

    @abstractmethod
    def law(
        self,
        memory: MemoryParts,
        tables: Sequence[ca.SX],
        measured: ca.SX,
        command: tuple[ca.SX, ca.SX],
    ) -> ca.SX:
        """Return the input u, (m,), and define the parts of the memory and their time derivatives.

        memory: parts of the memory, filled by this method
        tables: interpolated A, B, K, L, S, R⁻¹ and squared-up B
        measured: measured outputs
        command: r and r'
        """

    def nominal_memory(self) -> np.ndarray:
        """Return the initial memory, in which the adaptive parameters are nominal and everything
        else is 0.
        """
        memory = MemoryParts()
        nothing = ca.SX.zeros(len(self.inputs))
        self.law(
            memory,
            self._table.at(ca.SX(self.dihedral)),
            ca.SX.zeros(len(self.outputs.names)),
            (nothing, nothing),
        )
        return memory.start

    def control(self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX) -> ca.SX:
        """Return the inputs of the aircraft. Inputs that the law does not control are 0."""
        chosen = np.array([[float(name == one) for one in self.inputs] for name in INPUTS])
        return ca.mtimes(ca.DM(chosen), self._input_and_rate(t, measurements, memory)[0])

    def memory_rate(
        self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX, applied: ca.SX
    ) -> ca.SX:
        """Return the time derivative of the memory."""
        return self._input_and_rate(t, measurements, memory)[1]

    def _input_and_rate(
        self, t: ca.SX, measurements: Measurements, memory: ca.SX
    ) -> tuple[ca.SX, ca.SX]:
        parts = MemoryParts(memory)
        command = (self.commands.at(t), self.commands.rate(t))
        tables = self._table.at(self.dihedral + measurements.states[_DIHEDRAL])
        u = self.law(parts, tables, self.outputs.at(measurements), command)
        return u, parts.rate

    @cached_property
    def _table(self) -> MatrixTables:
        stacks = [np.array([getattr(each, name) for each in self.models]) for name in _TABLED]
        return MatrixTables(self.angles, stacks)


class AdaptiveDegree2(AdaptivePolicy):
    """Law u = Π{Λ̂'v̄ - Ψ1'x̄1 - Ψ2'x̄2} with Π = α0 + α1 d/dt.

    v = -K x_m is filtered by α0 v̄ + α1 v̄' = α0 v, and x̄ follows from x_m by the same filter:

        x_m' = (A - B K) x_m - [0; I] r + L e_y + B_s Π{Ψm'ē},
        e_y = y - C x_m,   ē' = R⁻¹S e_y - (α0/α1) ē,
        Λ̂' = -Γ v̄ (S1 e_y)',  Ψ1' = Γ x̄1 (S1 e_y)',  Ψ2' = Γ x̄2 (S1 e_y)',  Ψm' = Γ ē (S e_y)'.

    x̄1 contains the six states of the aircraft, and x̄2 also the actuators. S1 consists of the
    first two rows of S, and B_s is the squared-up input matrix.
    """

    def law(
        self,
        memory: MemoryParts,
        tables: Sequence[ca.SX],
        measured: ca.SX,
        command: tuple[ca.SX, ca.SX],
    ) -> ca.SX:
        """Return the commanded inputs by the equations in the docstring of the class."""
        a0, a1 = ALPHAS[1]
        A, B, K, L, S, R_inverse, squared_up = tables
        integrals = memory.take(_M)
        model = memory.take(_XA[1] + _M)
        r = command[0]
        memory.move(integrals, measured[1:] - r)
        off = ca.vertcat(measured[0], integrals.now) - ca.mtimes(ca.DM(self.models[0].C), model.now)
        mixed = ca.mtimes(S, off)
        v = -ca.mtimes(K, model.now)

        def followed(size: int, x: ca.SX, gain: float) -> tuple[ca.SX, ca.SX]:
            """Return x filtered by gain / (s + α0/α1), and the derivative of the filtered x.

            size: number of entries of x
            """
            part = memory.take(size)
            rate = gain * x - a0 / a1 * part.now
            memory.move(part, rate)
            return part.now, rate

        def operated(
            weights: Part, gamma: float, regressor: tuple[ca.SX, ca.SX], error: ca.SX
        ) -> ca.SX:
            """Set the time derivative of the weights Ψ to γ x e' and return Π{Ψ'x}.

            regressor: x and x'
            error: e
            """
            rate = gamma * ca.mtimes(regressor[0], error.T)
            memory.move(weights, rate)
            slow = ca.mtimes(weights.now.T, regressor[1]) + ca.mtimes(rate.T, regressor[0])
            return a0 * ca.mtimes(weights.now.T, regressor[0]) + a1 * slow

        v_bar = followed(_M, v, a0 / a1)
        x_bar = followed(_XA[1], model.now[: _XA[1]], a0 / a1)
        of_aircraft = x_bar[0][:_X], x_bar[1][:_X]
        u = operated(memory.take(_M, _M, np.eye(_M)), -GAMMA_EFFECTIVENESS[1], v_bar, mixed[:_M])
        u -= operated(memory.take(_X, _M), GAMMA_STATE, of_aircraft, mixed[:_M])
        u -= operated(memory.take(_XA[1], _M), GAMMA_STATE, x_bar, mixed[:_M])
        e_bar = followed(_Y, ca.mtimes(R_inverse, mixed), 1.0)
        added = ca.mtimes(squared_up, operated(memory.take(_Y, _Y), GAMMA_MODEL[1], e_bar, mixed))
        commanded = ca.vertcat(ca.SX.zeros(_XA[1]), -r)
        memory.move(
            model, ca.mtimes(A, model.now) + ca.mtimes(B, v) + ca.mtimes(L, off) + commanded + added
        )
        return u


class AdaptiveDegree3(AdaptivePolicy):
    """Law u = Π{Λ̂'v̄ - Ψ1'x_p - Ψ2'x̄1 - Ψ3'x̄2} - (α1 Ψ1' + α2 Ψ1'')' ε.

    Tuners (`Tuner`) supply Ψ and its derivatives:

        x_m' = (A - B K) x_m - [0; I] r + L e_y + F_e - F_ε,
        ε' = the rows of L e_y that belong to the aircraft,
        F_e = B32 (Ψ4'ē1)' + B3 (α0 Ψ4'ē1 + Π{Ψ4'ē12} + Π{Ψ5'ē2}),
        F_ε = B32 (Λ̂2'ε̄1)' + B3 (α0 Λ̂2'ε̄1 + Π{Ψ6'ε̄12}).

    B3 = α2 B and B32 = α2 A B + α1 B. In F_e, B is squared up. ē is the filtered R⁻¹S e_y. The
    filters are:

    - 1/Π: v̄ from -K x_m
    - (α2 s + α1)/Π: x̄1 and ē1, and ε̄1 from (Ψ1'ε)'
    - α2/Π: x̄2 and ē2, ē12 from (Ψ4'ē1)', and ε̄12 from (Λ̂2'ε̄1)'
    """

    def law(
        self,
        memory: MemoryParts,
        tables: Sequence[ca.SX],
        measured: ca.SX,
        command: tuple[ca.SX, ca.SX],
    ) -> ca.SX:
        """Return the commanded inputs by the equations in the docstring of the class."""
        A, B, K, L, S, R_inverse, squared_up = tables
        r, r_rate = command
        one = np.eye(_M)
        integrals = memory.take(_M)
        model = memory.take(_XA[2] + _M)
        memory.move(integrals, measured[1:] - r)
        x = model.now
        off = ca.vertcat(measured[0], integrals.now) - ca.mtimes(ca.DM(self.models[0].C), x)
        mixed = ca.mtimes(S, off)
        v = -ca.mtimes(K, x)
        pushed = ca.mtimes(L, off)
        commanded, commanded_rate = (ca.vertcat(ca.SX.zeros(_XA[2]), -each) for each in (r, r_rate))

        added = self._of_errors(memory, ca.mtimes(R_inverse, mixed), mixed, (A2 * squared_up, A))
        drift = memory.take(_X)
        memory.move(drift, pushed[:_X])
        x_rates = (
            ca.mtimes(A, x) + commanded,
            ca.mtimes(A, ca.mtimes(A, x) + commanded - pushed) + commanded_rate,
        )
        artificial = x[:_X], x_rates[0][:_X], x_rates[1][:_X]
        psi_1 = Tuner(memory, _X, _M).drive(GAMMA_STATE, artificial[0], mixed[:_M])
        added -= self._of_drift(memory, psi_1, (drift.now, pushed[:_X]), mixed[:_M], (A2 * B, A))

        x_rate = x_rates[0] + pushed + ca.mtimes(B, v) + added
        memory.move(model, x_rate)
        slow = Filter(memory, _XA[2]).drive(x[: _XA[2]])
        x_1 = tuple(each[:_X] for each in slow.high(x_rate[: _XA[2]]))
        psi_2 = Tuner(memory, _X, _M).drive(GAMMA_STATE, x_1[0], mixed[:_M])
        psi_3 = Tuner(memory, _XA[2], _M).drive(GAMMA_STATE, slow.low[0], mixed[:_M])
        v_bar = Filter(memory, _M).drive(v).plain
        effect = Tuner(memory, _M, _M, one).drive(-GAMMA_EFFECTIVENESS[2], v_bar[0], mixed[:_M])
        u = operated(effect, v_bar) - operated(psi_1, artificial)
        u -= operated(psi_2, x_1) + operated(psi_3, slow.low)
        return u - ca.mtimes((A2 * psi_1[2] + A1 * psi_1[1]).T, drift.now)

    @staticmethod
    def _of_errors(
        memory: MemoryParts, scaled: ca.SX, mixed: ca.SX, path: tuple[ca.SX, ca.SX]
    ) -> ca.SX:
        """Return the term F_e of the equations in the docstring of the class."""
        bar = Filter(memory, _Y).drive(scaled)
        bar_12 = Filter(memory, _Y)
        psi_4 = Tuner(memory, _Y, _Y)
        psi_5 = Tuner(memory, _Y, _Y)
        e_1 = bar.high()
        found_4 = psi_4.drive(GAMMA_MODEL[2], e_1[0] + bar_12.low_now, mixed)
        moved = product_rate(found_4, e_1)
        within = operated(found_4, bar_12.drive(moved).low)
        within += operated(psi_5.drive(GAMMA_MODEL[2], bar.low[0], mixed), bar.low)
        return _along(path, moved, A0 * ca.mtimes(found_4[0].T, e_1[0]) + within)

    @staticmethod
    def _of_drift(
        memory: MemoryParts,
        psi_1: Sequence[ca.SX],
        drift: Sequence[ca.SX],
        error: ca.SX,
        path: tuple[ca.SX, ca.SX],
    ) -> ca.SX:
        """Return the term F_ε of the equations in the docstring of the class."""
        bar_1 = Filter(memory, _M).drive(product_rate(psi_1, drift)).high()
        effect = memory.take(_M, _M, np.eye(_M))
        bar_12 = Filter(memory, _M)
        effect_rate = -GAMMA_EFFECTIVENESS[2] * ca.mtimes(bar_1[0], error.T)
        memory.move(effect, effect_rate)
        moved = product_rate((effect.now, effect_rate), bar_1)
        low = bar_12.drive(moved).low
        within = operated(Tuner(memory, _M, _M).drive(-GAMMA_MODEL[2], low[0], error), low)
        return _along(path, moved, A0 * ca.mtimes(effect.now.T, bar_1[0]) + within)


def _along(path: tuple[ca.SX, ca.SX], moved: ca.SX, still: ca.SX) -> ca.SX:
    """Return B32 moved + B3 still, where B32 = A B3 + (α1 / α2) B3."""
    B3, A = path
    return ca.mtimes(A, ca.mtimes(B3, moved)) + ca.mtimes(B3, A1 / A2 * moved + still)


def adaptive_law(
    order: int,
    aircraft: Model,
    point: OperatingPoint,
    commands: CommandSteps,
    angles: np.ndarray,
) -> Policy:
    """Return SimVFA's adaptive law for actuators of this order, with nominal initial parameters.

    order: 1 or 2
    angles: breakpoints of the dihedral angle, rad
    """
    kind = AdaptiveDegree2 if order == 1 else AdaptiveDegree3
    design = simvfa_design(f"simvfa-{order}")
    models = [
        reference_model(design_model(aircraft, level_model(aircraft, angle), design))
        for angle in angles.tolist()
    ]
    outputs = MeasuredOutputs(aircraft, point, (RATE, *REGULATED))
    fastest = max(spectral_radius(each.A - each.L @ each.C) for each in models)
    identity = {
        "law": kind.__name__,
        "angles": angles,
        "times": commands.times,
        "values": commands.values,
    }
    policy = kind(
        f"simvfa-{order} adaptive",
        commands,
        outputs,
        point.states.dihedral,
        angles,
        models,
        design.inputs,
        identity=identity,
        fastest=fastest,
    )
    return replace(policy, start=policy.nominal_memory())
