"""Box of states in which critics are compared with the exact solution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.expansion.expansion import Expansion, rates_about_trim
from controller.expansion.radius import STEPS_PER_TEST, flown_until_decayed, scales_of_time
from controller.game.zero_sum import Game
from controller.riccati.balls import ROUNDOFF
from controller.riccati.suboptimality import reference_cost
from hfa_aircraft.batch_simulation import (
    FAR_OF_EXPANSION,
    Cost,
    Figures,
    ReportedFigure,
    resolved,
    saturated,
)
from hfa_aircraft.limits import Limits
from hfa_model.parameters import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.matrices import quadratic_forms
from hfa_support.native.row_code import row_code
from hfa_support.reporting.results import Result, Vector
from hfa_support.reporting.text import percent
from hfa_support.units import si_factor, si_unit
from trim.linear.frequency_response import units_of
from trim.linear.linear_model import LinearModel

#: Half-widths of the box of typical deviations of the aircraft: ft/s, rad and rad/s, in the order
#: of `LINEAR_STATES`. They have the size of the commands in Section 5.1, and less for the dihedral.
ORDINARY_DEVIATIONS = (7.0, 0.1, 0.1, 0.1, 0.1, 0.1)


class Box(NamedTuple):
    """Box |z_i| <= half_widths[i] of states in which V, its gradient and the policies are compared.

    half_widths: (n,), in the units of the states
    about: source of the half-widths, as text
    name: name of the box in the first line of a verdict, "box" after an adjective
    """

    half_widths: Vector
    about: str
    name: str = "given box"


def ordinary_box(
    states: tuple[str, ...], inputs: tuple[str, ...], state_units: tuple[str, ...]
) -> Box | None:
    """Return the box of typical deviations of the paper's aircraft.

    The result is None for another plant, and for units that are neither English nor SI. Units that
    are not given ("") are English.

    states, inputs: names, which must be those of the aircraft, of some or all of its inputs
    state_units: units of the states
    """
    if states != LINEAR_STATES or not set(inputs) <= set(INPUTS):
        return None
    widths = np.array(ORDINARY_DEVIATIONS)
    speed = f"{widths[0]:g} ft/s"
    if any(state_units) and state_units != LINEAR_UNITS:
        if state_units != tuple(si_unit(unit) for unit in LINEAR_UNITS):
            return None
        widths = widths * [si_factor(unit) for unit in LINEAR_UNITS]
        speed = f"{widths[0]:.4g} m/s"
    about = f"states of {speed}, 0.1 rad, 0.1 rad/s"
    return Box(widths, about, "typical box")


def usual_box(game: Game) -> Box:
    """Return the box in which critics of a game are compared if no box is given.

    - the paper's aircraft: the box of typical deviations
    - a linear model whose states have limits: the largest box within them
    - otherwise: the balanced units of the game

    game: the game, in continuous or in discrete time
    """
    names = game.names
    box = ordinary_box(names.states, names.inputs, names.state_units)
    if box is not None:
        return box
    if game.half_widths is not None:
        about = "states within the limits that the model declares"
        return Box(game.half_widths, about, "box of limits")
    about = "states with which the terms of the game are of similar size, as no limits are declared"
    return Box(balanced_units(game), about, "balanced box")


def balanced_units(game: Game) -> np.ndarray:
    """Return units of the states, powers of two, in which the terms of a game are of similar size,
    (n,).
    """
    plain = game.without_cross_weights
    # The undiscounted game of √α A, √α B, √α E has the same value; α is 1 in continuous time.
    root = math.sqrt(game.discount)
    B = root * plain.B
    weight = game.R + B.T @ plain.Q @ B if game.is_discrete else game.R
    E = root * plain.E / game.delta
    # Sizes of the terms count, not their signs: that of the disturbance is added.
    return units_of(root * plain.A, B @ np.linalg.pinv(weight) @ B.T + E @ E.T, plain.Q)


def starts_in(b: np.ndarray, count: int, seed: int = 1) -> np.ndarray:
    """Return random initial conditions in the box |z_i| <= b_i, (count, n).

    Every second initial condition, beginning with the first, is a corner of the box.

    b: (n,)
    """
    starts = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(b)))
    starts[::2] = np.sign(starts[::2])  # corners
    return starts * b


class NonlinearPlant(NamedTuple):
    """Nonlinear plant in deviations z and u of state and input from its trim.

    rates: CasADi Function (z, u) -> z'
    lowest, highest: (m,), limits of u, which include 0
    """

    rates: ca.Function
    lowest: np.ndarray
    highest: np.ndarray

    def closed(self, z: ca.SX, u: ca.SX) -> ca.SX:
        """Return the rate z' for a state z and an input u, which is saturated at its limits."""
        return self.rates(z, self.saturated(u))

    def saturated(self, u: ca.SX) -> ca.SX:
        """Return an input u within its limits."""
        return saturated(u, ca.DM(self.lowest), ca.DM(self.highest))


def nonlinear_plant(linear: LinearModel) -> NonlinearPlant:
    """Return the nonlinear plant about the trim of a linear model, with the limits of its inputs.

    The plant has the states and inputs of the linear model. All other states and inputs keep
    their values at the trim.
    """
    trim = linear.point.inputs._asdict()
    limits = Limits.of(linear.point.model, linear.inputs)
    at_trim = np.array([trim[name] for name in linear.inputs], dtype=float)
    # Zero, the trim itself, stays permitted if the trim violates a limit.
    lowest = np.minimum(limits.lowest - at_trim, 0.0)
    highest = np.maximum(limits.highest - at_trim, 0.0)
    return NonlinearPlant(rates_about_trim(linear), lowest, highest)


#: Largest cost of a critic's flight above that of the exact policy, relative to the largest
#: optimum of the box.
SHARE = 0.05
#: Relative excess of a cost that may be rounding: half an ulp in each of a million steps.
_ROUNDING_OF_COST = 1e6 * ROUNDOFF
#: Longest flight, in durations after which flights of the exact policy have converged.
_LONGEST_FLIGHT = 10.0
#: The parts of the box are 1, 1/2, 1/4, ..., at least this.
_SMALLEST_PART = 2.0**-12


@dataclass(frozen=True, eq=False)
class BoxFlights(Result):
    """Flights of a critic from the largest part of the box from which the exact policy converges.

    The exact policy is that of the nonlinear game, as polynomials. The flights have the input
    limits of the aircraft and no disturbance. They begin at corners and random states of the part.

    box: name of the box
    part: the part, a power of two; 0 if the exact policy converges from none
    half_widths: half-widths of the part, (n,)
    flights: number of flights
    diverged: number of flights of the critic that diverge
    undecided: number of its flights that are not decided at the end of the clock
    clock: largest duration of a flight, s
    suboptimality: largest cost above that of the exact policy from the same state, relative to the
        `reference_cost` of the linear game; inf if a flight diverges, nan if one is not decided
    worst: initial state with it, (n,)
    integration: integration error of the costs
    resolved: whether the costs hardly change with half the step
    """

    box: str
    part: float
    half_widths: Vector
    clock: float
    worst: Vector
    flights: int = 0
    diverged: int = 0
    undecided: int = 0
    suboptimality: float = math.inf
    integration: str = ""
    resolved: bool = False

    def within(self, share: float) -> bool:
        """Return whether all flights converge, are resolved, and cost at most a share more."""
        return self.part > 0.0 and self.suboptimality <= share and self.resolved

    @property
    def where(self) -> str:
        """The part of the box as text."""
        if self.part in (0.0, 1.0):
            return self.box
        return f"{self.part:g} of the {self.box}"

    @property
    def sentence(self) -> str:
        """Text: how many flights do not converge, or else the largest excess of their cost, and
        whether it is resolved.
        """
        if not self.part:
            return "the exact policy converges from no part of the box"
        if self.diverged:
            return f"{self.diverged} of {self.flights} flights diverge"
        if self.undecided:
            clock = f"{self.clock:.3g} s"
            return f"{self.undecided} of {self.flights} flights are not decided within {clock}"
        above = 0.0 if self.suboptimality < _ROUNDING_OF_COST else self.suboptimality
        more = percent(100.0 * above, up=True)
        text = (
            f"{self.flights} flights cost at most {more} of the largest optimum more than by the"
            " exact policy"
        )
        return text if self.resolved else f"{text}, but are not resolved"


class _Costs(NamedTuple):
    """Costs of flights of both policies, (N,): inf if they diverge, nan if they are not decided."""

    judged: np.ndarray
    exact: np.ndarray


def box_flights(
    policy: ca.Function,
    exact_policy: ca.Function,
    expansion: Expansion,
    plant: NonlinearPlant,
    box: Box,
    count: int,
) -> BoxFlights:
    """Fly a policy and the exact policy from the same states of a part of a box.

    policy, exact_policy: CasADi Functions z (n,) -> u (m,)
    expansion: the nonlinear game, whose cost is integrated
    count: number of initial states
    """
    b = box.half_widths
    loop = expansion.game.A - expansion.game.B @ expansion.solution.K
    step, seconds = scales_of_time(loop)  # of integration, and until exact flights have converged
    exact = _Flights(expansion, exact_policy, plant, seconds)
    flown = _Flights(expansion, policy, plant, seconds)
    starts = starts_in(b, count)
    part = 1.0  # halved until all flights of the exact policy converge
    while part >= _SMALLEST_PART and not np.isfinite(exact.costs(part * starts, step)).all():
        part /= 2.0
    if part < _SMALLEST_PART:
        none = np.zeros(len(b))
        return BoxFlights(box=box.name, part=0.0, half_widths=none, clock=flown.seconds, worst=none)

    def simulate(per_step: int) -> _Costs:
        """Return the costs, with `per_step` steps of integration in place of each."""
        begins, shorter = part * starts, step / per_step
        return _Costs(judged=flown.costs(begins, shorter), exact=exact.costs(begins, shorter))

    costs, error = resolved(simulate, _converged_costs, step)
    optima = quadratic_forms(part * starts, reference_cost(expansion.solution.P, b))
    suboptimality = (costs.judged - costs.exact) / optima
    # A flight that is not decided (nan) counts as the worst, as one that diverges does.
    worst = int(np.argmax(np.where(np.isnan(suboptimality), math.inf, suboptimality)))
    return BoxFlights(
        box=box.name,
        part=part,
        half_widths=part * b,
        flights=count,
        diverged=int(np.isinf(costs.judged).sum()),
        undecided=int(np.isnan(costs.judged).sum()),
        clock=flown.seconds,
        suboptimality=float(suboptimality[worst]),
        worst=part * starts[worst],
        integration=error.text(),
        resolved=error.is_resolved,
    )


def _converged_costs(costs: _Costs) -> Figures:
    """Return the costs of flights that converge, whose change with half the step is tested."""
    return {
        f"cost {number} of the {policy} policy": ReportedFigure(float(cost))
        for policy, from_starts in costs._asdict().items()
        for number, cost in enumerate(from_starts)
        if np.isfinite(cost)
    }


class _Flights:
    """Flights of a policy on the nonlinear plant with its saturated inputs, and their cost."""

    def __init__(
        self, expansion: Expansion, policy: ca.Function, plant: NonlinearPlant, seconds: float
    ) -> None:
        game = expansion.game
        z = ca.SX.sym("z", len(game.A))
        u = plant.saturated(policy(z))
        cost = Cost(game.Q, game.R, game.N).rate(z, u)
        both = ca.densify(ca.vertcat(plant.rates(z, u), cost))  # rates of [z; cost]
        self._rates = row_code(ca.Function("rates", [z], [both], {"cse": True}))
        self._P = expansion.solution.P
        self.seconds = _LONGEST_FLIGHT * seconds

    def costs(self, starts: np.ndarray, step: float) -> np.ndarray:
        """Return the cost of the flights from N states, (N,), inf of those that diverge, and nan of
        those that are not decided within `seconds`.

        starts: (N, n)
        """
        # Decay is tested every `STEPS_PER_TEST` steps.
        ticks = 1 + int(self.seconds / (step * STEPS_PER_TEST))
        final, has_ended = flown_until_decayed(self._rates, starts, self._P, step, ticks)
        cost_to_go = quadratic_forms(final[:, :-1], self._P)  # final has states, then costs
        is_far = ~(cost_to_go <= FAR_OF_EXPANSION * quadratic_forms(starts, self._P))  # so is a nan
        return np.where(has_ended, final[:, -1] + cost_to_go, np.where(is_far, math.inf, math.nan))
