"""What is flown, as deviations from one operating point: the linear model or the nonlinear aircraft, whose parameters
are numbers or an input of the loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np

from controller.policy.policies import Unvaried
from hfa_model.aircraft import Aircraft
from hfa_model.dynamics import rates
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES, Input, Quantity, State
from hfa_support.errors import BadInputError
from trim.point.operating_point import OperatingPoint


class Plant(Protocol):
    """A plant in deviations from its operating point, as CasADi expressions.

    states: names. rate: x' of the deviation x, for an input deviation u (5,), a disturbance d (6,) that adds to
    the rates of the six states of the linear model, and an updraft of the air, ft/s. seen: those six deviations.
    p: what differs from flight to flight (the parameters of the aircraft, say); mostly nothing.
    """

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states, in order."""

    @property
    def constants_size(self) -> int:
        """Length of p."""

    def rate(self, x: ca.SX, u: ca.SX, d: Quantity, updraft: Quantity = 0.0, p: ca.SX | None = None) -> ca.SX:
        """dx/dt."""

    def seen(self, x: ca.SX) -> ca.SX:
        """The deviations of `LINEAR_STATES`, (6,)."""


class SevenStates:
    """A plant with all states of the aircraft."""

    states = STATES

    def seen(self, x: ca.SX) -> ca.SX:
        """The six states of the linear model."""
        return ca.mtimes(ca.DM(spread().T), x)


@dataclass(frozen=True, eq=False)
class LinearPlant(Unvaried):
    """x' = A x + B u + d (paper Eq. 12). A: (6, 6), B: (6, 5).

    It knows nothing of moving air: BadInputError when it is simulated in a gust (`LinearizedAircraft` can be).
    """

    states = LINEAR_STATES

    A: np.ndarray
    B: np.ndarray

    def rate(self, x: ca.SX, u: ca.SX, d: Quantity, updraft: Quantity = 0.0, p: ca.SX | None = None) -> ca.SX:
        """A x + B u + d."""
        if not (isinstance(updraft, float) and updraft == 0.0):
            raise BadInputError("the six-state linear model has no gust input: use the linearized or nonlinear one")
        return ca.mtimes(ca.DM(self.A), x) + ca.mtimes(ca.DM(self.B), u) + d

    def seen(self, x: ca.SX) -> ca.SX:
        """The whole state."""
        return x


class Equations(NamedTuple):
    """A variant of the equations with its parameters, which may be CasADi symbols (an `Aircraft` has numbers)."""

    parameters: Parameters
    variant: Variant


@dataclass(frozen=True, eq=False)
class NonlinearPlant(SevenStates, Unvaried):
    """X' = f(X, U, w) + d with X = X0 + x, U = U0 + u: the seven-state aircraft about an operating point.

    d adds to the rates of the six states of the linear model; the altitude rate is kinematic and has none.
    """

    aircraft: Aircraft | Equations
    point: OperatingPoint

    def __post_init__(self) -> None:
        """A trim of other dynamics is none of this aircraft."""
        self.point.refuse_other(self.aircraft.variant)

    def rate(self, x: ca.SX, u: ca.SX, d: Quantity, updraft: Quantity = 0.0, p: ca.SX | None = None) -> ca.SX:
        """f(X0 + x, U0 + u, w), disturbed."""
        X = State(*ca.vertsplit(ca.DM(np.array(self.point.states)) + x))
        U = Input(*ca.vertsplit(ca.DM(np.array(self.point.inputs)) + u))
        rate = ca.vertcat(*rates(X, U, self.aircraft.parameters, self.aircraft.variant, updraft))
        return rate + ca.mtimes(ca.DM(spread()), d)


@dataclass(frozen=True, eq=False)
class LinearizedAircraft(SevenStates, Unvaried):
    """x' = A x + B u + d + b w with A = ∂f/∂X, B = ∂f/∂U, b = ∂f/∂w at (X0, U0, 0): what `NonlinearPlant` is to first
    order, altitude included.

    A: (7, 7), B: (7, 5), gust: b, (7,).
    """

    A: np.ndarray
    B: np.ndarray
    gust: np.ndarray

    @classmethod
    def at(cls, aircraft: Aircraft, point: OperatingPoint) -> LinearizedAircraft:
        """The exact derivatives at an operating point of the aircraft."""
        x, u, w = ca.SX.sym("x", len(STATES)), ca.SX.sym("u", len(INPUTS)), ca.SX.sym("w")
        rate = NonlinearPlant(aircraft, point).rate(x, u, ca.DM.zeros(len(LINEAR_STATES)), w)
        derivatives = ca.Function("derivatives", [x, u, w], [ca.jacobian(rate, part) for part in (x, u, w)])
        A, B, gust = (np.array(ca.DM(part)) for part in derivatives(0, 0, 0))
        return cls(A, B, gust.ravel())

    def rate(self, x: ca.SX, u: ca.SX, d: Quantity, updraft: Quantity = 0.0, p: ca.SX | None = None) -> ca.SX:
        """A x + B u + b w, disturbed."""
        rate = ca.mtimes(ca.DM(self.A), x) + ca.mtimes(ca.DM(self.B), u) + ca.DM(self.gust) * updraft
        return rate + ca.mtimes(ca.DM(spread()), d)


def spread() -> np.ndarray:
    """(7, 6): the six states of the linear model among the seven."""
    return np.array([[float(name == other) for other in LINEAR_STATES] for name in STATES])


@dataclass(frozen=True, eq=False)
class UncertainAircraft(SevenStates):
    """X' = f(X0 + x, U0 + u, w; θ) + d: `NonlinearPlant` with the parameters θ as an input, p = θ (18,)."""

    constants_size = len(Parameters._fields)

    variant: Variant
    point: OperatingPoint

    def rate(self, x: Any, u: Any, d: Any, updraft: Any = 0.0, p: Any = None) -> Any:
        """f(X0 + x, U0 + u, w; p), disturbed."""
        flown = Equations(Parameters(*ca.vertsplit(p)), self.variant)
        return NonlinearPlant(flown, self.point).rate(x, u, d, updraft)
