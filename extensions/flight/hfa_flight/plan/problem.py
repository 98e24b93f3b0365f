"""Optimal control problem of flights: aircraft, trim, cost and limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.game.linear_game import (
    default_weight,
    game,
    matrix_text,
    weights_of_flights,
)
from controller.riccati.gare import solve
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.policies.policy import deviations_of, input_limits
from hfa_flight.simulate.envelope import flight_envelope
from hfa_support.errors import BadInputError, is_finite, refuse_unknown, shown
from hfa_support.reporting.results import Matrix
from hfa_support.units import si_unit
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.operating_point import OperatingPoint
from verification.box import ordinary_box

#: Fraction by which the state limits of a candidate are narrowed, so that the flight that follows
#: it stays in the envelope.
MARGIN = 4e-3
#: Two trims have the same value of a state if they differ by less than this fraction of its nominal
#: value.
_SAME_STATE = 1e-6


class NominalValues(NamedTuple):
    """Nominal values of the followed states, (followed,), and of the moving inputs, (m,)."""

    states: np.ndarray
    inputs: np.ndarray


@dataclass(frozen=True, eq=False)
class FlightProblem:
    """Problem of minimizing ∫ z'Qz + v'Rv dt for flights to a trim within limits.

    z are the deviations of the linear model's k states from the trim. v are the deviations of the m
    moving inputs. The optimizer follows these states and then the carried ones: states outside the
    linear model on which its rates depend, such as the altitude.

    linear: linear model at the trim, with the moving inputs only
    Q: weight of the linear model's states, (k, k)
    R: weight of the moving inputs, (m, m)
    P: matrix of the linear model's least cost z'Pz without limits, (k, k)
    K: gain of the linear model's optimal policy v = -K z, (m, k)
    envelope: limits of all states
    """

    linear: LinearModel
    Q: Matrix
    R: Matrix
    P: np.ndarray
    K: np.ndarray
    envelope: Limits

    @property
    def point(self) -> OperatingPoint:
        """Trim to which flights converge."""
        return self.linear.point

    @property
    def model(self) -> Model:
        """Model of the aircraft."""
        return self.point.model

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the linear model's states, whose deviations are z."""
        return self.linear.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the moving inputs."""
        return self.linear.inputs

    @cached_property
    def places(self) -> list[int]:
        """Indices of the linear model's states among all states."""
        return self.model.state_places(self.states)

    @cached_property
    def carried(self) -> tuple[str, ...]:
        """Names of the states outside the linear model on which the rates of its states depend.

        A state is included if these rates depend on it directly or through another such state.
        An example is the altitude.
        """
        every = ca.SX.sym("x", len(self.model.states))
        vectors = every, self.point.inputs, self.model.p
        every_rate, _ = self.model.layout.expressions(vectors, ())
        depends = ca.DM(ca.jacobian(every_rate, every).sparsity(), 1).full() != 0.0
        followed = set(self.places)
        while True:  # add the states on which the followed ones depend, until none is missing
            needed = set(np.flatnonzero(depends[sorted(followed)].any(axis=0)).tolist())
            if needed <= followed:
                break
            followed |= needed
        names = list(self.model.states)
        return tuple(names[place] for place in sorted(followed - set(self.places)))

    @property
    def followed(self) -> tuple[str, ...]:
        """Names of the states of the optimizer: the linear model's, then the carried states."""
        return (*self.states, *self.carried)

    @cached_property
    def followed_places(self) -> list[int]:
        """Indices of the followed states among all states."""
        return self.model.state_places(self.followed)

    def padded(self, z: np.ndarray) -> np.ndarray:
        """Return the deviations of the followed states, (..., followed).

        Carried states that are missing from the argument are 0.

        z: deviations, (..., k) or (..., followed)
        """
        missing = len(self.followed) - z.shape[-1]
        return np.pad(z, [(0, 0)] * (z.ndim - 1) + [(0, missing)])

    @cached_property
    def moved(self) -> list[int]:
        """Indices of the moving inputs among all inputs."""
        return self.model.input_places(self.inputs)

    @cached_property
    def nominal(self) -> NominalValues:
        """Nominal values by which deviations are divided in nominal units."""
        return NominalValues(self.model.nominal(self.followed), self.model.nominal(self.inputs))

    def followed_of(self, X: Any) -> np.ndarray:
        """Return the deviations of the followed states in nominal values, (followed,).

        X: all states of one sample, absolute, (n,) or by name in their order

        Raises the errors of `deviations_of`.
        """
        return deviations_of(self.point, X)[self.followed_places] / self.nominal.states

    def inputs_of(self, v: np.ndarray) -> np.ndarray:
        """Return all inputs, absolute, from the deviations of the moving inputs in nominal values.

        v: (m,)
        """
        U = self.point.u  # a new array
        U[self.moved] += v * self.nominal.inputs
        return U

    def gain_of(self, nominal: np.ndarray) -> np.ndarray:
        """Return the gain K (m, k) of v = -K z from that of nominal values."""
        of_states, of_inputs = self.nominal
        return nominal * of_inputs[:, None] / of_states[: nominal.shape[1]]

    @cached_property
    def input_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest values of v, (m,) each."""
        lowest, highest = input_limits(self.point)
        return lowest[self.moved], highest[self.moved]

    @cached_property
    def state_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest deviations of the followed states, (followed,) each."""
        trim = self.point.x
        lowest = (self.envelope.lowest - trim)[self.followed_places]
        return lowest, (self.envelope.highest - trim)[self.followed_places]

    def inner_limits(self, start: np.ndarray, margin: float) -> tuple[np.ndarray, np.ndarray]:
        """Return lowest and highest deviations of the followed states, (followed,) each, for an
        optimizer.

        The limits are narrower than `state_limits`. A limit that would exclude the initial
        condition is moved to the initial condition.

        start: initial deviations of the followed states, (followed,)
        margin: fraction by which each limit is narrowed
        """
        lowest, highest = self.state_limits
        lowest = np.minimum((1.0 - margin) * lowest, start)
        return lowest, np.maximum((1.0 - margin) * highest, start)

    @cached_property
    def rates(self) -> ca.Function:
        """CasADi function (followed states, v) -> time derivatives of the followed states.

        The argument is one column of deviations. Those of states and inputs, and the derivatives,
        are divided by nominal values. Inputs that do not move have their trim values.
        """
        of_states, of_inputs = self.nominal
        count = len(self.followed) + len(self.inputs)
        column = ca.SX.sym("column", count)
        X = [ca.SX(value) for value in self.point.states]
        U = [ca.SX(value) for value in self.point.inputs]
        for row, place in enumerate(self.followed_places):
            X[place] += float(of_states[row]) * column[row]
        for row, place in enumerate(self.moved):
            U[place] += float(of_inputs[row]) * column[len(self.followed) + row]
        every_rate, _ = self.model.layout.expressions((X, U, self.model.p), ())
        rates = ca.densify(every_rate[self.followed_places] / ca.DM(of_states))
        return ca.Function("rates", [column], [rates], {"cse": True})

    def scaled_weights(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return Q, (followed, followed), R, (m, m), and P, (followed, followed), for nominal
        values.

        The weights of carried states are 0.
        """
        of_states, of_inputs = self.nominal
        of_both = np.outer(of_states, of_states)
        carried = [(0, len(self.carried))] * 2
        Q, P = (np.pad(weight, carried) * of_both for weight in (self.Q, self.P))
        return Q, self.R * np.outer(of_inputs, of_inputs), P

    def deviations(self, start: Mapping[str, float] | OperatingPoint) -> np.ndarray:
        """Return an initial condition as deviations z from the trim, (k,).

        start: state -> deviation, or another trim

        Raises BadInputError in these cases:
        - A name is unknown, or a number is not finite.
        - The other trim belongs to another model, or differs in a state outside the linear model.
        - The initial condition is outside the limits, or equals the trim of the problem.
        """
        if isinstance(start, OperatingPoint):
            z = self._deviations_of_trim(start)
        else:
            z = np.zeros(len(self.states))
            for name, value in start.items():
                refuse_unknown("a flight has no initial deviation of", name, self.states)
                if not is_finite(value):
                    raise BadInputError(
                        f"the initial deviation of {name} is {shown(value)}; give a finite number"
                    )
                z[self.states.index(name)] = value
        if not z.any():
            raise BadInputError(
                "the initial condition equals the final trim; give another initial condition"
            )
        self.refuse_outside(z)
        return z

    def _deviations_of_trim(self, other: OperatingPoint) -> np.ndarray:
        """Return another trim as deviations z from the trim of the problem, (k,)."""
        other._refuse_other_model(self.model)  # a trim of another model
        off: np.ndarray = np.array(other.states) - self.point.x
        for place, name in enumerate(self.model.states):
            if (
                place not in self.places
                and abs(off[place]) > _SAME_STATE * self.model.states[name].nominal
            ):
                raise BadInputError(
                    f"the two trims differ in {name}, which is not a state of the linear model; "
                    f"impose the same value of {name} in both trims"
                )
        return off[self.places]

    def weights_text(self) -> str:
        """Return Q and R as text, marked where they are the default."""
        signals = (*self.states, *self.inputs)
        return f"cost: {cost_text(self.model, signals, self.Q, self.R)}"

    def refuse_outside(self, z: np.ndarray) -> None:
        """Raise BadInputError if an initial condition is outside the limits.

        z: initial deviations, (k,)
        """
        away = np.zeros(len(self.point.x))
        away[self.places] = z
        broken = self.envelope.broken(self.point.x + away, verb="begins at")
        if broken:
            raise BadInputError(f"{broken[0]}; give an initial condition within the limits")


class OfProblem:
    """Base class of results that have a `problem`: access to its aircraft, trim and weights."""

    problem: FlightProblem

    @property
    def point(self) -> OperatingPoint:
        """Trim to which flights converge."""
        return self.problem.point

    @property
    def model(self) -> Model:
        """Model of the aircraft."""
        return self.problem.model

    def weights_text(self) -> str:
        """Return Q and R as text, marked where they are the default."""
        return self.problem.weights_text()

    @property
    def Q(self) -> Matrix:
        """Weight of the linear model's states, (k, k)."""
        return self.problem.Q

    @property
    def R(self) -> Matrix:
        """Weight of the moving inputs, (m, m)."""
        return self.problem.R


def flight_problem(
    model: Model,
    point: OperatingPoint,
    Q: Any = None,
    R: Any = None,
    inputs: Sequence[str] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> FlightProblem:
    """Return the optimal control problem of flights to a trim.

    Q, R: weights, as `hfa.game` accepts them, by default those of `weights_of_flights`; R is the
        weight of the moving inputs
    inputs: inputs that move, by default all; the others are constant
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope

    Raises BadInputError for a point of another model, a trim outside the limits, and for names and
    weights that do not fit the model. Raises NoSolutionError if the linear model cannot be
    stabilized at a finite cost.
    """
    point._refuse_other_model(model)
    linear = linearize(model, point)
    if inputs is not None:
        for name in inputs:
            refuse_unknown("there is no input", name, linear.inputs)
        linear = linear.select(inputs=tuple(inputs))
    lqr = game(linear, **weights_of_flights(linear, Q, R), delta=np.inf)
    lqr.refuse_cross_weights("the cost of these flights")
    solution = solve(lqr)
    envelope = flight_envelope(model, point, limits, of_outputs=False)
    return FlightProblem(linear, lqr.Q, lqr.R, solution.P, solution.K, envelope)


def cost_text(
    model: Model,
    names: Sequence[str],
    Q: np.ndarray,
    R: np.ndarray,
) -> str:
    """Return Q and R as one line of text, marked where they are the default, with its source.

    The text is, for example, "Q diag(1, 2) (file), R diag(1) (1/nominal^2, as by default)".

    names: states of Q, then inputs of R
    """
    parts = []
    for name, weight in (("Q", Q), ("R", R)):
        usual = default_weight(name, model, names[: len(Q)], names[len(Q) :])
        about = model.about
        source = about.weights_source if name in about.weights else "1/nominal^2, as by default"
        is_usual = np.allclose(weight, usual, rtol=1e-12, atol=0.0)
        parts.append(f"{name} {matrix_text(weight)}" + f" ({source})" * is_usual)
    return ", ".join(parts)


#: Largest half-width of a box, relative to the distance from the trim to the nearer limit.
_PART_OF_LIMITS = 0.9


def start_box(model: Model, point: OperatingPoint) -> np.ndarray:
    """Return the half-widths (k,) of the initial-condition box in the linear states about a trim.

    - Angles and angular rates: the nominal value.
    - Other states with a trim value of at least half the nominal value in magnitude, such as the
      speed: 10 % of the nominal value.
    - Other states: the nominal value.

    A half-width is at most half the distance to a limit.
    """
    widths = []
    for name in model.linear:
        signal = model.states[name]
        value = float(getattr(point.states, name))
        width = signal.nominal
        if si_unit(signal.unit) not in ("rad", "rad/s") and abs(value) >= 0.5 * signal.nominal:
            width = 0.1 * signal.nominal
        room = min(value - signal.min, signal.max - value)
        widths.append(min(width, 0.5 * max(room, 0.0)))
    return np.array(widths)


def usual_box(problem: FlightProblem) -> np.ndarray:
    """Return the half-widths of the default box of initial deviations, (k,), within the limits.

    For the HFA, the box contains its typical deviations. For other aircraft, the box is that of
    `hfa assess`.
    """
    states = problem.states
    box = ordinary_box(states, tuple(problem.model.inputs), problem.model.units(states))
    half = start_box(problem.model, problem.point) if box is None else box.half_widths
    return _inside(problem, half)


def _inside(problem: FlightProblem, half: np.ndarray) -> np.ndarray:
    """Return half-widths, (k,), of at most 90 % of the distance to the nearer limit of a state."""
    lowest, highest = (limit[: len(half)] for limit in problem.state_limits)
    return np.minimum(half, _PART_OF_LIMITS * np.minimum(-lowest, highest))


def drawn_starts(
    problem: FlightProblem, count: int, seed: int, box: np.ndarray | None = None
) -> np.ndarray:
    """Return random initial conditions in a box, as deviations from trim, (count, k).

    With the same seed, a larger count returns the same initial conditions first.

    box: half-widths, (k,), reduced to fit in the limits. The default is `usual_box`.
    """
    rng = np.random.default_rng(seed)
    half = usual_box(problem) if box is None else _inside(problem, box)
    return half * rng.uniform(-1.0, 1.0, (count, len(problem.states)))
