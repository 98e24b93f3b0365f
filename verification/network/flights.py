"""Simulations of a nonlinear policy, in continuous and in discrete time.

A simulation gives a lower bound on the largest cost, and an upper bound on the box from which
the loop converges.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.riccati.gare import Solution
from controller.riccati.suboptimality import Excess
from hfa_aircraft.batch_simulation import Outcome
from hfa_support.matrices import quadratic_forms
from hfa_support.reporting.report import Check, at_most
from hfa_support.reporting.text import percent
from verification.box import starts_in
from verification.network.loops import Loop, plant_loop, undisturbed_loop, worst_loop

if TYPE_CHECKING:
    from verification.plant import NonlinearPlant

#: Number of initial conditions for a wide network, whose policy takes 2 to 20 ms.
_WIDE_FLIGHTS = 2
#: Largest number of initial conditions in the search for the largest box, and k of its multiples
#: 2^-k ... 2^k.
FEW = 6
DOUBLINGS = 4


class FlightResults(NamedTuple):
    """Results of simulations of a critic that is not quadratic.

    The fields are named as in the JSON output. A tested multiple of the box is a power of two. The
    loop converges from all smaller tested multiples too.

    flights: number of initial conditions, or 0 if nothing was simulated.
    cost_lost_flown_percent: largest cost above V*, in percent of V*; inf if a simulation diverges,
        nan if one is not decided at the end of its clock. For a linear policy, it is the largest
        excess over all initial conditions.
    cost_lost_flown_mean_percent: mean cost above V*, in percent of V*, or inf or nan.
    undecided_at: end of the clock of the simulation that is not decided, s or steps, or None.
    rest_point: (n,), equilibrium of the policy on the linear plant, or None.
    equilibrium_cost: cost of the equilibrium per second, or per discrete step; 0 at the trim.
    reach: largest tested multiple of the box from which the loop converges on the linear plant, or
        0.
    reach_nonlinear: `reach` on the nonlinear plant, or None without such a plant.
    reach_nonlinear_exact: `reach` of the exact policy on the nonlinear plant, or None without such
        a plant.
    """

    flights: int = 0
    cost_lost_flown_percent: float = math.inf
    cost_lost_flown_mean_percent: float = math.inf
    undecided_at: float | None = None
    rest_point: np.ndarray | None = None
    equilibrium_cost: float = 0.0
    reach: float = 0.0
    reach_nonlinear: float | None = None
    reach_nonlinear_exact: float | None = None


def equilibrium_check(
    equilibrium: np.ndarray | None, P: np.ndarray, b: np.ndarray, limit: float
) -> Check:
    """Return the check of V* at the equilibrium, in percent of its mean over the corners of the
    box, tr(b P b).

    V* is the cost of steering from the equilibrium to the trim. It is quadratic in the distance: an
    equilibrium at 0.1 of the box costs about 1 %.

    equilibrium: equilibrium, (n,), or None if none was found; the cost is then infinite
    P: matrix of V*, (n, n)
    b: half-widths of the box of states, (n,)
    limit: largest distance that passes, relative to the box
    """
    most = 100.0 * limit**2
    if equilibrium is None:
        return at_most("rest_point", math.inf, most, "no equilibrium near trim", kind="rest")
    cost = float(equilibrium @ P @ equilibrium)
    share = 100.0 * cost / float(np.diag(P) @ b**2) if cost > 0.0 else 0.0
    distance = float((np.abs(equilibrium) / b).max())
    reason = f"equilibrium {distance:.2g} boxes off trim, V* there {percent(share, up=True)}"
    return at_most("rest_point", share, most, reason, kind="rest")


def fly(
    exact: Solution,
    critic: Critic,
    excess: Excess,
    b: np.ndarray,
    flights: int,
    plant: NonlinearPlant | None = None,
) -> FlightResults:
    """Simulate a critic that is not quadratic from the box |z_i| <= b_i.

    Nothing is simulated if the critic has non-finite values or its linear loop is unstable.

    excess: cost of the policy u = -K z above the optimum
    flights: number of initial conditions. At most `_WIDE_FLIGHTS` are used for a wide network
    plant: nonlinear plant of a critic in continuous time, or None
    """
    game = exact.game
    if not flights or not critic.is_finite:
        return FlightResults()
    if not excess.is_stable:
        return FlightResults()
    if critic.is_wide:
        flights = min(flights, _WIDE_FLIGHTS)
    losses, undecided_at = costs_above_optimum(exact, critic, excess, b, flights)
    loop = undisturbed_loop(exact, critic, b)
    equilibrium_cost = 0.0
    if loop.equilibrium is not None:
        z_and_u = np.append(loop.equilibrium, critic.u(loop.equilibrium))
        equilibrium_cost = float(z_and_u @ game.weights @ z_and_u)
    few = min(FEW, flights)
    results = FlightResults(
        flights=flights,
        cost_lost_flown_percent=float(losses.max()),
        cost_lost_flown_mean_percent=float(losses.mean()),
        undecided_at=undecided_at,
        rest_point=loop.equilibrium,
        equilibrium_cost=equilibrium_cost,
        reach=_reach(loop, b, few),
    )
    if plant is None:
        return results
    return results._replace(
        reach_nonlinear=_reach(plant_loop(exact, plant, critic, b), b, few),
        reach_nonlinear_exact=_reach(plant_loop(exact, plant, None, b), b, few),
    )


def costs_above_optimum(
    exact: Solution, critic: Critic, excess: Excess, b: np.ndarray, flights: int
) -> tuple[np.ndarray, float | None]:
    """Return the cost above V* from each initial condition, in percent of V*, (flights,), and the
    end of the clock, s or steps, if a simulation is not decided, or None.

    The first initial condition is the worst one of the linear loop. The loop is under the worst
    disturbance of the critic's linear part. The cost after the end of a simulation is computed for
    the linear loop. All costs are inf if a simulation diverges or the linear loop has no bounded
    cost, and nan if a simulation is not decided.
    """
    remaining = excess.matrix
    if remaining is None:
        return np.full(flights, math.inf), None
    loop = worst_loop(exact, critic, excess, b)
    worst = excess.worst if np.any(np.nan_to_num(excess.worst)) else b
    starts = np.vstack([worst, starts_in(b, flights - 1)])
    end = loop.simulate(starts)
    if end.outcome is Outcome.LEFT:
        return np.full(flights, math.inf), None
    if end.outcome is Outcome.UNDECIDED:
        return np.full(flights, math.nan), float(end.times.max())
    after_end = exact.game.discount**end.times * quadratic_forms(end.z, remaining)
    costs, optima = end.costs + after_end, quadratic_forms(starts, exact.P)
    without_optimum = np.where(costs > 0.0, math.inf, 0.0)  # where the optimum is 0
    with np.errstate(divide="ignore", invalid="ignore"):
        losses = np.maximum(100.0 * costs / optima, 0.0)
    return np.where(optima > 0.0, losses, without_optimum), None


def _reach(loop: Loop, b: np.ndarray, few: int) -> float:
    """Return the largest tested multiple of the box from which all simulations converge, or 0.

    The multiples are the powers of two from 2^-`DOUBLINGS` to 2^`DOUBLINGS`.

    b: half widths of the box |z| <= b, (n,)
    few: number of simulations from each multiple
    """

    def converges(size: float) -> bool:
        """Return whether all flights from a multiple of the box converge."""
        starts = size * starts_in(b, few)
        first, others = starts[:1], starts[1:]  # the corner may fail before all fly
        return all(
            loop.simulate(each).outcome is Outcome.CONVERGED
            for each in (first, others)
            if len(each)
        )

    size = 1.0
    if converges(size):
        while size < 2.0**DOUBLINGS and converges(2.0 * size):
            size *= 2.0
        return size
    while size > 2.0**-DOUBLINGS:
        size /= 2.0
        if converges(size):
            return size
    return 0.0
