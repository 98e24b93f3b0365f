"""Exact linear models at an operating point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.support.by_value import ByValue
from hfa_model.support.errors import BadInputError
from hfa_model.support.report import Report, Reported
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, STATES
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(ByValue, Reported):
    """x' = A x + B u with x = X - X0, u = U - U0 (paper Eq. 9).

    A: (n, n), B: (n, 5). states, inputs: names, in order; units in `state_units`, `input_units`.
    point: the operating point, whose values are the offsets X0, U0.
    """

    A: np.ndarray
    B: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    point: OperatingPoint

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

    def select(self, states: tuple[str, ...]) -> LinearModel:
        """The model of the named states alone, the others held at their offsets."""
        unknown = [name for name in states if name not in self.states]
        if unknown:
            raise BadInputError(f"the model has no state {unknown[0]!r}; choose from {', '.join(self.states)}")
        rows = [self.states.index(name) for name in states]
        return replace(self, A=self.A[np.ix_(rows, rows)], B=self.B[rows], states=states)

    def report(self) -> Report:
        """A, B, offsets and modes."""
        from trim.linear.model_report import linear_model_report

        return linear_model_report(self)

    def to_control(self) -> control.StateSpace:
        """The same model as python-control's `StateSpace`, every state an output, names kept."""
        import control

        n, m = self.B.shape
        names = {"states": list(self.states), "inputs": list(self.inputs), "outputs": list(self.states)}
        return control.ss(self.A, self.B, np.eye(n), np.zeros((n, m)), **names)


def linearize(aircraft: Aircraft, point: OperatingPoint, *, full: bool = False) -> LinearModel:
    """A = ∂f/∂X, B = ∂f/∂U at (X0, U0), by algorithmic differentiation (exact to rounding).

    Returns the six states of the paper's model (Section 2.2), or all seven with altitude when `full`.
    BadInputError when the point belongs to other dynamics than the aircraft.
    """
    if point.dynamics != aircraft.variant.name:
        raise BadInputError(
            f"the operating point was trimmed with {point.dynamics!r} dynamics, the aircraft has "
            f"{aircraft.variant.name!r}; trim it again"
        )
    _, A, B = aircraft.jacobians(np.array(point.states), np.array(point.inputs))
    model = LinearModel(A, B, STATES, INPUTS, point)
    return model if full else model.select(LINEAR_STATES)
