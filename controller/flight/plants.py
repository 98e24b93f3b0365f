"""What is flown, as deviations from one operating point: a linear model or the equations of any `Model`, whose
parameters are numbers or an input of the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import casadi as ca
import numpy as np

from controller.flight.envelope import ALPHA, ANGLE_OF_ATTACK, flown_through_air
from controller.policy.policies import Unvaried
from hfa_model.aircraft import Aircraft
from hfa_support.errors import BadInputError
from hfa_support.model import Model, components
from trim.point.operating_point import OperatingPoint

#: The disturbance of a model that a gust is.
UPDRAFT = "updraft"
#: Disturbance of the model -> its value; those that are not there are 0.
Winds = Mapping[str, Any]


class Sizes(NamedTuple):
    """How many numbers: x, the states of the linear model among them, u."""

    states: int
    seen: int
    inputs: int


class Plant(Protocol):
    """A plant in deviations from its operating point, as CasADi expressions.

    rate: x' of the deviation x (n,), for an input deviation u (m,), a disturbance d (k,) that adds to the rates of the
    states of the linear model, and disturbances of the model. seen: the deviations of those states, (k,).
    p: what differs from flight to flight (the parameters of the aircraft, say); mostly nothing.
    """

    @property
    def sizes(self) -> Sizes:
        """n, k, m."""

    @property
    def constants_size(self) -> int:
        """Length of p."""

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds | None = None, p: ca.SX | None = None) -> ca.SX:
        """dx/dt."""

    def seen(self, x: ca.SX) -> ca.SX:
        """The deviations of the states of the linear model, (k,)."""

    def through_air(self, x: ca.SX, winds: Winds) -> ca.SX:
        """The deviation of alpha through the air where it is not alpha, (1,); else (0,)."""


class _StillAir:
    """A plant whose alpha is the state of that name."""

    def through_air(self, x: ca.SX, winds: Winds) -> ca.SX:
        """Nothing, (0,)."""
        return ca.SX(0, 1)


@dataclass(frozen=True, eq=False)
class LinearPlant(Unvaried, _StillAir):
    """x' = A x + B u + d (paper Eq. 12). A: (n, n), B: (n, m).

    It knows nothing of moving air: BadInputError when it is simulated in a gust (`LinearizedAircraft` can be).
    """

    A: np.ndarray
    B: np.ndarray

    @property
    def sizes(self) -> Sizes:
        """All states are seen."""
        return Sizes(len(self.A), *np.shape(self.B))

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds | None = None, p: ca.SX | None = None) -> ca.SX:
        """A x + B u + d."""
        if winds:
            raise BadInputError("a linear model of A and B has no gust input: use the linearized or nonlinear aircraft")
        return ca.mtimes(ca.DM(self.A), x) + ca.mtimes(ca.DM(self.B), u) + d

    def seen(self, x: ca.SX) -> ca.SX:
        """The whole state."""
        return x


class ModelPlant(_StillAir):
    """A plant with all states of a model."""

    model: Model

    @property
    def sizes(self) -> Sizes:
        """Of the model."""
        return Sizes(len(self.model.states), len(self.model.linear), len(self.model.inputs))

    def seen(self, x: ca.SX) -> ca.SX:
        """The states of the linear model."""
        return ca.mtimes(ca.DM(spread(self.model).T), x)

    def disturbed(self, rate: ca.SX, d: Any) -> ca.SX:
        """The rate with d in those of the states of the linear model."""
        return rate + ca.mtimes(ca.DM(spread(self.model)), d)


@dataclass(frozen=True, eq=False)
class NonlinearPlant(ModelPlant):
    """X' = f(X, U, p, w) + d with X = X0 + x, U = U0 + u: the equations of an aircraft about an operating point.

    d adds to the rates of the states of the linear model. uncertain: the parameters of the model are an input, p.
    BadInputError when the point was trimmed with another model.
    """

    aircraft: Aircraft | Model
    point: OperatingPoint
    uncertain: bool = False

    def __post_init__(self) -> None:
        """A trim of other dynamics is none of this aircraft."""
        self.point.refuse_other(self.model)

    @property
    def model(self) -> Model:  # type: ignore[override]
        """Whose equations these are."""
        return self.aircraft.model

    @property
    def constants_size(self) -> int:
        """The parameters where they are an input."""
        return len(self.model.parameters) if self.uncertain else 0

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds | None = None, p: ca.SX | None = None) -> ca.SX:
        """f(X0 + x, U0 + u, p, w), disturbed."""
        model = self.model
        X = components(ca.DM(np.array(self.point.states)) + x)
        U = components(ca.DM(np.array(self.point.inputs)) + u)
        parameters = components(p) if self.uncertain and p is not None else model.p.tolist()
        w = [(winds or {}).get(name, 0.0) for name in model.disturbances]
        return self.disturbed(model.layout.expressions((X, U, parameters), (), w)[0], d)

    def through_air(self, x: ca.SX, winds: Winds) -> ca.SX:
        """The output `ANGLE_OF_ATTACK` in winds, of a model that has one beside alpha.

        BadInputError where it depends on an input: then it is no angle of the flow alone.
        """
        model = self.model
        if not winds or not flown_through_air(model):
            return ca.SX(0, 1)
        u, X = ca.SX.sym("u", len(model.inputs)), components(ca.DM(np.array(self.point.states)) + x)
        w = [winds.get(name, 0.0) for name in model.disturbances]
        angle = model.layout.expressions((X, components(u), model.p.tolist()), (ANGLE_OF_ATTACK,), w)[1]
        if ca.depends_on(angle, u):
            raise BadInputError(f"{model.name}: {ANGLE_OF_ATTACK} depends on an input; rename that output")
        return angle - getattr(self.point.states, ALPHA)


@dataclass(frozen=True, eq=False)
class LinearizedAircraft(ModelPlant, Unvaried):
    """x' = A x + B u + d + E w with A = ∂f/∂X, B = ∂f/∂U, E = ∂f/∂w at (X0, U0, 0): what `NonlinearPlant` is to first
    order, in all states.

    A: (n, n), B: (n, m), E: disturbance -> (n,).
    """

    model: Model
    A: np.ndarray
    B: np.ndarray
    E: Mapping[str, np.ndarray]

    @classmethod
    def at(cls, aircraft: Aircraft | Model, point: OperatingPoint, winds: Sequence[str] = ()) -> LinearizedAircraft:
        """The exact derivatives at an operating point of the aircraft, those by these disturbances among them."""
        model = aircraft.model
        found = model.at(point.states, point.inputs, disturbances=winds)
        return cls(model, found.A, found.B, dict(zip(winds, found.E.T, strict=True)))

    def rate(self, x: ca.SX, u: ca.SX, d: Any, winds: Winds | None = None, p: ca.SX | None = None) -> ca.SX:
        """A x + B u + E w, disturbed."""
        rate = ca.mtimes(ca.DM(self.A), x) + ca.mtimes(ca.DM(self.B), u)
        for name, w in (winds or {}).items():
            rate = rate + ca.DM(self.E[name]) * w
        return self.disturbed(rate, d)


def spread(model: Model) -> np.ndarray:
    """(n, k): the states of the linear model among all."""
    return np.array([[float(name == other) for other in model.linear] for name in model.states])
