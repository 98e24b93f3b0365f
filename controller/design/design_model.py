"""The design model: a linear model with actuators and integrals in one set of matrices, names kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.design.design import SHORT_PERIOD, Design
from controller.game.zero_sum import Game
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import LINEAR_STATES
from trim.linear.linearize import LinearModel
from trim.linear.output_model import OutputModel, output_model


@dataclass(frozen=True, eq=False)
class DesignModel:
    """z' = A z + B u + E w of `design` about the operating point of `model`.

    z: the states of the linear model, then actuator positions, rates and integrals (`states`). A: (n, n). B: (n, m).
    E: (n, 6) or (n, 1). Units: those of the linear model; an integral has its output's times s.
    """

    design: Design
    model: LinearModel
    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of z, in order."""
        return self.design.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the commands, in order."""
        return self.design.inputs

    def game(self) -> Game:
        """J = ∫ z'Qz + u'Ru - δ² w'w with the weights of the design."""
        Q = np.diag([float(self.design.state_weights.get(name, 0.0)) for name in self.states])
        R = np.diag([float(self.design.input_weights[name]) for name in self.inputs])
        return Game(A=self.A, B=self.B, E=self.E, Q=Q, R=R, delta=self.design.delta)


def design_model(aircraft: Aircraft, model: LinearModel, design: Design) -> DesignModel:
    """x' = A x + B a + E w,  actuators from commands to a,  e' = C x + D a + F w.

    model: of six states, made of this aircraft. BadInputError when an output is not one.
    """
    plain = tuple(name.removesuffix(SHORT_PERIOD) for name in design.integrals)
    outputs = output_model(aircraft, model.point, plain)
    n, names = len(LINEAR_STATES), design.states
    columns = [model.inputs.index(name) for name in design.inputs]
    C, D, F = _integrated(design, outputs)
    A, B = np.zeros((len(names), len(names))), np.zeros((len(names), len(columns)))
    A[:n, :n] = model.A
    integrals = slice(len(names) - len(design.integrals), len(names))
    A[integrals, :n] = C
    for number, (name, column) in enumerate(zip(design.inputs, columns, strict=True)):
        acting = A[:, names.index(f"{name}_position")] if name in design.actuators else B[:, number]
        acting[:n], acting[integrals] = model.B[:, column], D[:, column]
        if name in design.actuators:
            _connect(A, B, number, names, name, design)
    E = np.zeros((len(names), n if design.disturbance == "states" else 1))
    E[:n] = np.eye(n) if design.disturbance == "states" else outputs.E
    if design.disturbance == "updraft":
        E[integrals] = F
    units = dict(zip(model.inputs, model.input_units, strict=True))
    return DesignModel(design, model, A, B, E, _units(design, model, outputs), tuple(units[i] for i in design.inputs))


def _connect(A: np.ndarray, B: np.ndarray, number: int, names: tuple[str, ...], name: str, design: Design) -> None:
    """The rows of one actuator."""
    actuator, position = design.actuators[name], names.index(f"{name}_position")
    w = actuator.bandwidth
    if actuator.order == 1:
        A[position, position], B[position, number] = -w, w * actuator.effectiveness
        return
    rate = names.index(f"{name}_rate")
    A[position, rate] = 1.0
    A[rate, position], A[rate, rate] = -(w**2), -2 * actuator.damping * w
    B[rate, number] = w**2 * actuator.effectiveness


def _integrated(design: Design, outputs: OutputModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """C, D, F of the integrated outputs; of a short-period one alpha and the inputs only."""
    C, D, F = outputs.C.copy(), outputs.D.copy(), outputs.F.copy()
    for row, name in enumerate(design.integrals):
        if name.endswith(SHORT_PERIOD):
            C[row, [state != "alpha" for state in LINEAR_STATES]] = 0.0
            F[row] = 0.0
    return C, D, F


def _units(design: Design, model: LinearModel, outputs: OutputModel) -> tuple[str, ...]:
    inputs = dict(zip(model.inputs, model.input_units, strict=True))
    found = dict(zip(model.states, model.state_units, strict=True))
    found |= {f"{name}_position": unit for name, unit in inputs.items()}
    found |= {f"{name}_rate": f"{unit}/s" for name, unit in inputs.items()}
    found |= {
        f"{name}_integral": f"{unit} s" for name, unit in zip(design.integrals, outputs.output_units, strict=True)
    }
    return tuple(found[name] for name in design.states)
