"""Flights of a critic on the nonlinear plant, from a part of the box of states."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.expansion.expansion import Expansion
from controller.expansion.radius import TESTED, flown_until_decayed, scales_of_time
from controller.riccati.balls import ROUNDOFF
from hfa_aircraft.batch_simulation import FAR_OF_EXPANSION, Cost, Figures, ReportedFigure, resolved
from hfa_support.matrices import quadratic_forms
from hfa_support.native.row_code import row_code
from hfa_support.reporting.results import Result, Vector
from hfa_support.reporting.text import percent
from verification.box import Box, starts_in
from verification.plant import NonlinearPlant

#: Largest cost of a critic's flight above that of the exact policy, relative to it.
SHARE = 0.05
#: Relative excess of a cost that may be rounding: half an ulp in each of a million steps.
_ROUNDING = 1e6 * ROUNDOFF
#: Longest flight, in durations after which flights of the exact policy have converged.
_CLOCK = 10.0
#: The parts of the box are 1, 1/2, 1/4, ..., at least this.
_SMALLEST = 2.0**-12


@dataclass(frozen=True, eq=False)
class BoxFlights(Result):
    """Flights of a critic from the largest part of the box from which the exact policy converges.

    The exact policy is that of the nonlinear game, as polynomials. The flights have the input
    limits of the aircraft and no disturbance. They begin at corners and random states of the part.

    box: name of the box
    part: the part, a power of two; 0 if the exact policy converges from none
    half_widths: half-widths of the part, (n,)
    flights: number of flights
    lost: number of flights of the critic that diverge
    undecided: number of its flights that are not decided at the end of the clock
    clock: largest duration of a flight, s
    excess: largest cost above that of the exact policy from the same state, relative to it; inf if
        a flight diverges, nan if one is not decided
    worst: initial state with this excess, (n,)
    integration: integration error of the costs
    resolved: whether the costs hardly change with half the step
    """

    box: str
    part: float
    half_widths: Vector
    clock: float
    worst: Vector
    flights: int = 0
    lost: int = 0
    undecided: int = 0
    excess: float = math.inf
    integration: str = ""
    resolved: bool = False

    def within(self, share: float) -> bool:
        """Return whether all flights converge, are resolved, and cost at most a share more."""
        return self.part > 0.0 and self.excess <= share and self.resolved

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
        if self.lost:
            return f"{self.lost} of {self.flights} flights diverge"
        if self.undecided:
            clock = f"{self.clock:.3g} s"
            return f"{self.undecided} of {self.flights} flights are not decided within {clock}"
        more = percent(0.0 if self.excess < _ROUNDING else 100.0 * self.excess, up=True)
        text = f"{self.flights} flights cost at most {more} more than by the exact policy"
        return text if self.resolved else f"{text}, but are not resolved"


class _Costs(NamedTuple):
    """Costs of the flights of the judged and the exact policy, (N,), inf or nan if they diverge or
    are not decided.
    """

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
    step, seconds = scales_of_time(loop)
    exact = _Flights(expansion, exact_policy, plant, seconds)
    flown = _Flights(expansion, policy, plant, seconds)
    starts = starts_in(b, count)
    part = 1.0
    while part >= _SMALLEST and not np.isfinite(exact.costs(part * starts, step)).all():
        part /= 2.0
    if part < _SMALLEST:
        return BoxFlights(box.name, 0.0, 0.0 * b, flown.seconds, 0.0 * b)

    def simulate(per_step: int) -> _Costs:
        return _Costs(*(each.costs(part * starts, step / per_step) for each in (flown, exact)))

    costs, error = resolved(simulate, _figures, step)
    excess = costs.judged / costs.exact - 1.0
    worst = int(np.argmax(np.where(np.isnan(excess), math.inf, excess)))
    return BoxFlights(
        box=box.name,
        part=part,
        half_widths=part * b,
        flights=count,
        lost=int(np.isinf(costs.judged).sum()),
        undecided=int(np.isnan(costs.judged).sum()),
        clock=flown.seconds,
        excess=float(excess[worst]),
        worst=part * starts[worst],
        integration=error.text(),
        resolved=error.is_resolved,
    )


def _figures(costs: _Costs) -> Figures:
    """Return the costs whose change with half the step is tested, without those of lost flights.

    The cost of a lost flight is inf.
    """
    return {
        f"cost {number} of the {who} policy": ReportedFigure(float(cost))
        for who, each in costs._asdict().items()
        for number, cost in enumerate(each)
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
        both = ca.densify(ca.vertcat(plant.rates(z, u), cost))
        self._rates = row_code(ca.Function("rates", [z], [both], {"cse": True}))
        self._P = expansion.solution.P
        self.seconds = _CLOCK * seconds

    def costs(self, starts: np.ndarray, step: float) -> np.ndarray:
        """Return the cost of the flights from N states, (N,), inf of those that diverge, and nan of
        those that are not decided within `seconds`.

        starts: (N, n)
        """
        ticks = 1 + int(self.seconds / (step * TESTED))
        final, has_ended = flown_until_decayed(self._rates, starts, self._P, step, ticks)
        cost_to_go = quadratic_forms(final[:, :-1], self._P)
        is_far = ~(cost_to_go <= FAR_OF_EXPANSION * quadratic_forms(starts, self._P))  # so is a nan
        return np.where(has_ended, final[:, -1] + cost_to_go, np.where(is_far, math.inf, math.nan))
