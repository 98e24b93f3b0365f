"""Exact linear models at an operating point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.reporting.report import Report, Reported
from hfa_model.support.by_value import ByValue
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, STATES
from trim.linear.output_model import UPDRAFT, OutputModel, output_model
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(ByValue, Reported):
    """x' = A x + B u with x = X - X0, u = U - U0 (paper Eq. 9); y - Y0 = C x + D u + F w and x' = A x + B u + E w where
    outputs or disturbances were asked for.

    A: (n, n), B: (n, m). states, inputs: names, in order; units in `state_units`, `input_units`.
    point: the operating point, whose values are the offsets X0, U0. output_part: None when
    nothing else was asked for: the outputs are the states, and E and F have no columns.
    """

    A: np.ndarray
    B: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    point: OperatingPoint
    output_part: OutputModel | None = None

    @property
    def outputs(self) -> tuple[str, ...]:
        """Name of each output, in order: the states unless others were asked for."""
        return self.states if self.output_part is None else self.output_part.outputs

    @property
    def output_units(self) -> tuple[str, ...]:
        """Unit of each output, in order."""
        return self.state_units if self.output_part is None else self.output_part.output_units

    @property
    def C(self) -> np.ndarray:
        """(k, n), the identity when the outputs are the states."""
        return np.eye(len(self.states)) if self.output_part is None else self.output_part.C

    @property
    def D(self) -> np.ndarray:
        """(k, m), zero when the outputs are the states."""
        return np.zeros(self.B.shape) if self.output_part is None else self.output_part.D

    @property
    def disturbances(self) -> tuple[str, ...]:
        """Name of each wind w, in order."""
        return () if self.output_part is None else self.output_part.disturbances

    @property
    def disturbance_units(self) -> tuple[str, ...]:
        """Unit of each wind, in order."""
        return () if self.output_part is None else self.output_part.disturbance_units

    @property
    def E(self) -> np.ndarray:
        """∂f/∂w, (n, l)."""
        return np.zeros((len(self.states), 0)) if self.output_part is None else self.output_part.E

    @property
    def F(self) -> np.ndarray:
        """∂y/∂w, (k, l)."""
        return np.zeros((len(self.states), 0)) if self.output_part is None else self.output_part.F

    @property
    def state_units(self) -> tuple[str, ...]:
        """Unit of each state, in order."""
        return tuple(getattr(STATE_UNITS, name) for name in self.states)

    @property
    def input_units(self) -> tuple[str, ...]:
        """Unit of each input, in order."""
        return tuple(getattr(INPUT_UNITS, name) for name in self.inputs)

    @property
    def state_offsets(self) -> np.ndarray:
        """X0 of the model's states, (n,)."""
        return np.array([getattr(self.point.states, name) for name in self.states])

    @property
    def input_offsets(self) -> np.ndarray:
        """U0, (5,)."""
        return np.array([getattr(self.point.inputs, name) for name in self.inputs])

    def select(self, states: tuple[str, ...] | None = None, inputs: tuple[str, ...] | None = None) -> LinearModel:
        """The model of the named states and inputs alone, the others held at their offsets; None keeps all.

        BadInputError when the model has no such name, or it comes twice.
        """
        rows, columns = _positions("state", states, self.states), _positions("input", inputs, self.inputs)
        return replace(
            self,
            A=self.A[np.ix_(rows, rows)],
            B=self.B[np.ix_(rows, columns)],
            states=tuple(self.states[i] for i in rows),
            inputs=tuple(self.inputs[i] for i in columns),
            output_part=None if self.output_part is None else self.output_part.part(rows, columns),
        )

    def report(self) -> Report:
        """A, B, offsets and modes."""
        from trim.linear.model_report import linear_model_report

        return linear_model_report(self)

    def to_control(self) -> control.StateSpace:
        """The same model as python-control's `StateSpace`, names kept."""
        import control

        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.outputs)}
        return control.ss(self.A, self.B, self.C, self.D, **names)


def linearize(
    aircraft: Aircraft,
    point: OperatingPoint,
    *,
    full: bool = False,
    outputs: tuple[str, ...] | None = None,
    disturbances: tuple[str, ...] | None = None,
    ground_drag: bool = False,
) -> LinearModel:
    """A = ∂f/∂X, B = ∂f/∂U, C = ∂y/∂X, D = ∂y/∂U, E = ∂f/∂w, F = ∂y/∂w at (X0, U0) in still air, by algorithmic
    differentiation (exact to rounding).

    Returns the six states of the paper's model (Section 2.2), or all seven with altitude when `full`.
    outputs: names of `hfa_model.outputs` or of states; None for the states of the model.
    disturbances: winds w with names of `hfa_model.winds`, ft/s; None for the uniform updraft where outputs are asked
    for. ground_drag: with these winds the drag takes the speed over ground, not that through the air.
    BadInputError when the point belongs to other dynamics than the aircraft, or an output or a wind is unknown.
    """
    if point.dynamics != aircraft.variant.name:
        raise BadInputError(
            f"the operating point was trimmed with {point.dynamics!r} dynamics, the aircraft has "
            f"{aircraft.variant.name!r}; trim it again"
        )
    _, A, B = aircraft.jacobians(np.array(point.states), np.array(point.inputs))
    watched = None
    if outputs is not None or disturbances is not None:
        seen = outputs or (STATES if full else LINEAR_STATES)
        watched = output_model(aircraft, point, seen, STATES, disturbances or UPDRAFT, ground_drag=ground_drag)
    model = LinearModel(A, B, STATES, INPUTS, point, watched)
    return model if full else model.select(LINEAR_STATES)


def _positions(what: str, names: tuple[str, ...] | None, known: tuple[str, ...]) -> list[int]:
    """Where the names stand among the known ones; None names all."""
    chosen = known if names is None else names
    for name in chosen:
        if name not in known:
            raise BadInputError(f"the model has no {what} {name!r}; choose from {', '.join(known)}")
        if chosen.count(name) > 1:
            raise BadInputError(f"{what} {name} is named twice; name it once")
    return [known.index(name) for name in chosen]
