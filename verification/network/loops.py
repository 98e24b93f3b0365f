"""Flights of critics that are not quadratic, on the linear plant.

A policy u = -K z + e costs J = V* + ∫ e'R e dt under the worst disturbance of the exact game, where
states and inputs count from an equilibrium of the policy; in discrete time it is the sum over the
steps, with R + α B'P B in place of R.

All flights of a loop are simulated at once, one in each row [z, cost].
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.network.operations import row_function
from controller.riccati.gare import Solution
from controller.riccati.suboptimality import reference_cost
from hfa_aircraft.batch_simulation import FAR_OF_VALUE, OF_VALUE, has_decayed
from hfa_support.matrices import quadratic_forms, spectral_abscissa
from verification.box import starts_in
from verification.verdict import CounterExample

#: A tick of a simulation in continuous time is as long as the exact loop needs to decay to
#: exp(-`_DECAY`). The longest flight has `_TICKS`: 500 time constants.
_DECAY, _TICKS = 5.0, 100
#: Largest number of steps of a simulation, LSODA's or those of a discrete loop, and number of the
#: latter in a tick.
_STEPS, _STEPS_PER_TICK = 10_000, 100
#: Largest number of Newton steps to an equilibrium, and its largest distance, in boxes.
_NEWTON_STEPS = 30
_FARTHEST_EQUILIBRIUM = 100.0
#: Error of a step of LSODA, relative to a number, and to its size in the box: three digits of costs
#: are printed, also of a ten-thousandth of the optimum.
_RELATIVE_ACCURACY, _ACCURACY_IN_BOX = 1e-7, 1e-9
#: Longest step, relative to a tick, of a flight that is shown: others may pass over a thin error.
_LONGEST_STEP = 2e-3
#: A last Newton step, relative to the box, after which only rounding changes the equilibrium.
_SETTLED_STEP = 1e-12
#: Distance of another equilibrium, relative to the box.
_ELSEWHERE = 1e-6
#: Distance of starts beside one, relative to the box.
_BESIDE = 1e-7


class End(NamedTuple):
    """End of flights.

    z: last deviations from the equilibrium, (N, n)
    costs: (N,)
    failed: number of a flight that diverges or has not converged, or None if all converge
    diverges: whether it diverges
    """

    z: np.ndarray
    costs: np.ndarray
    failed: int | None = None
    diverges: bool = False


def simulated(
    exact: Solution,
    critic: Critic,
    b: np.ndarray,
    equilibrium: np.ndarray,
    starts: np.ndarray,
    longest_step: float = math.inf,
) -> End:
    """Simulate flights from initial states (N, n), until one diverges.

    A flight converges when V* = z'Pz has decreased to `OF_VALUE` of its first value, and diverges
    when V* exceeds `FAR_OF_VALUE` times that of the box |z_i| <= b_i.

    longest_step: of LSODA, relative to a tick
    """
    game, K, weight = exact.game, exact.K, exact.suboptimality_weight
    F = game.A - game.B @ K + game.E @ exact.disturbance_gain
    policy = row_function(critic.policy) or critic.u
    u_at_rest = policy(equilibrium[None])
    size = float(b @ np.abs(exact.P) @ b)

    def rates(z: np.ndarray) -> np.ndarray:
        """Return z' or z⁺ and the rate of the cost, (N, n + 1)."""
        e = policy(equilibrium + z) - u_at_rest + z @ K.T
        return np.column_stack([z @ F.T + e @ game.B.T, quadratic_forms(e, weight)])

    def is_far(rows: np.ndarray) -> np.ndarray:
        return ~(quadratic_forms(rows[:, :-1], exact.P) <= FAR_OF_VALUE * size)  # or nan

    def steps(rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        """Return the rows after a tick of z⁺ = f(z), and the number of its steps, 0 of too many."""
        for step in range(_STEPS_PER_TICK):
            after = rates(rows[:, :-1])
            after[:, -1] = rows[:, -1] + game.discount ** (time + step) * after[:, -1]
            rows = after
        return rows, _STEPS_PER_TICK

    def flow(rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        """Return the rows after a tick of z' = f(z), by LSODA, and the number of its steps."""
        from scipy.integrate import odeint

        # The distance of each flight, in boxes: tolerances decrease with a flight that converges.
        sizes = np.append(b, size)
        distances = np.abs(rows / sizes).max(axis=1, keepdims=True)
        band = len(b)  # of a block-diagonal Jacobian: flights are independent

        def flat(numbers: np.ndarray, _: float) -> np.ndarray:
            """Return the rates; a flight that diverges stops."""
            now = numbers.reshape(rows.shape)
            return np.where(is_far(now)[:, None], 0.0, rates(now[:, :-1])).ravel()

        with warnings.catch_warnings(action="ignore"):  # of LSODA when it fails
            (*_, reached), report = odeint(
                flat,
                rows.ravel(),
                [0.0, period],
                full_output=True,
                ml=band,
                mu=band,
                rtol=_RELATIVE_ACCURACY,
                atol=(_ACCURACY_IN_BOX * distances * sizes).ravel(),
                hmax=longest_step * period,
                mxstep=most,
            )
        if report["message"] != "Integration successful.":
            return rows, 0
        return reached.reshape(rows.shape), int(report["nst"][-1])

    after, period, longest = steps, float(_STEPS_PER_TICK), math.inf
    if not game.is_discrete:
        period = _DECAY / abs(spectral_abscissa(game.A - game.B @ K))
        after, longest = flow, _TICKS * period
    rows = np.column_stack([starts - equilibrium, np.zeros(len(starts))])
    flying = np.arange(len(starts))  # rows of flights that have not converged
    initial, time, left = quadratic_forms(rows[:, :-1], exact.P), 0.0, _STEPS
    with np.errstate(all="ignore"):
        while flying.size and left > 0 and time < longest:
            rows[flying], taken = after(rows[flying], time, left)
            if (far := is_far(rows)).any():
                return End(rows[:, :-1], rows[:, -1], int(np.argmax(far)), diverges=True)
            left = left - taken if taken else 0
            time += period
            now = quadratic_forms(rows[flying, :-1], exact.P)
            flying = flying[~has_decayed(now, initial[flying], OF_VALUE)]
    failed = None
    if flying.size:
        failed = int(flying[np.argmax(quadratic_forms(rows[flying, :-1], exact.P))])
    return End(rows[:, :-1], rows[:, -1], failed)


def equilibrium_of(
    exact: Solution, critic: Critic, b: np.ndarray, start: np.ndarray
) -> np.ndarray | None:
    """Return the equilibrium z (n,) of a policy without a disturbance that Newton's method finds.

    The result is None without convergence. The iterates must stay within
    |z_i| <= `_FARTHEST_EQUILIBRIUM` b_i.
    """
    game, z, point = exact.game, critic.symbols, start
    rates = ca.DM(game.A) @ z + ca.DM(game.B) @ critic.policy(z)
    rates = rates - z if game.is_discrete else rates
    newton = ca.Function("newton", [z], [z - ca.solve(ca.jacobian(rates, z), rates)])
    for _ in range(_NEWTON_STEPS):
        before, point = point, np.array(newton(point)).ravel()
        if not (np.abs(point) <= _FARTHEST_EQUILIBRIUM * b).all():  # or nan
            return None
        if (np.abs(point - before) <= _SETTLED_STEP * b).all():
            return point
    return None


class FlightResults(NamedTuple):
    """Results of simulations of a critic that is not quadratic, named as in the JSON output.

    flights: number of initial conditions, or 0 if nothing was simulated.
    cost_above_optimum_flown_percent: largest cost above V*, in percent of the `reference_cost`; inf
        if a simulation diverges or ends at another equilibrium, nan if one is not decided.
    worst: the flight with the largest cost, or None if nothing was simulated or is not decided.
    """

    flights: int = 0
    cost_above_optimum_flown_percent: float = math.inf
    worst: CounterExample | None = None


@np.errstate(over="ignore")  # where P is 0
def fly(
    exact: Solution,
    critic: Critic,
    worst: np.ndarray,
    b: np.ndarray,
    flights: int,
    equilibrium: np.ndarray,
    violators: Sequence[np.ndarray],
) -> FlightResults:
    """Simulate a critic that is not quadratic from the box |z_i| <= b_i.

    worst: initial state from which u = -K z costs most, or one that is not finite or 0
    flights: number of initial conditions. The next are violators, limited to the box
    equilibrium: of the policy
    violators: deviations from the equilibrium at which the error of the policy is too large
    """

    def other_near(deviation: np.ndarray) -> np.ndarray | None:
        """Return another equilibrium, (n,)."""
        other = equilibrium_of(exact, critic, b, equilibrium + deviation)
        is_other = other is not None and (np.abs(other - equilibrium) > _ELSEWHERE * b).any()
        return other if is_other else None

    reference = reference_cost(exact.P, b)

    def flown(starts: np.ndarray, longest_step: float = math.inf) -> tuple[End, int, float]:
        """Return the end of flights, the number of that which fails or costs most, and its cost."""
        end = simulated(exact, critic, b, equilibrium, starts, longest_step)
        if end.failed is not None:
            return end, end.failed, math.inf
        # Near 0, the error of a network is absolute: what counts is the optimum of the box.
        optima = np.maximum(quadratic_forms(starts, reference), reference[0, 0] * b[0] ** 2)
        above = 100.0 * end.costs / optima
        return end, int(np.argmax(above)), float(above.max())

    def repeated(start: np.ndarray) -> FlightResults:
        """Return the result of one flight, in short steps."""
        end, _, cost = flown(start[None], _LONGEST_STEP)
        what = "diverges" if end.diverges else "costs more"
        if end.failed is not None and not end.diverges:
            what = "ends at another equilibrium"
            if other_near(end.z[0]) is None:
                return FlightResults(flights, math.nan)
        return FlightResults(flights, cost, CounterExample(start, what))

    beside, chosen = [], [worst] if np.any(np.nan_to_num(worst)) else []
    for violator in violators:
        chosen.append(equilibrium + violator)
        if (other := other_near(violator)) is not None:
            beside += [other - _BESIDE * b, other + _BESIDE * b]
    # Common steps of many flights are too long for a thin error that acts on few of them.
    starts = np.vstack([*chosen, *beside, starts_in(b, flights)])[:flights].clip(-b, b)
    places = np.cumsum([len(chosen), len(beside)])
    shown, most = worst, -math.inf
    for group in filter(len, np.split(starts, places)):
        end, place, cost = flown(group)
        if end.failed is not None:
            found = repeated(group[place])
            if math.isinf(found.cost_above_optimum_flown_percent):
                return found
            most = math.nan
        elif cost > most:
            shown, most = group[place], cost
    return FlightResults(flights, math.nan) if math.isnan(most) else repeated(shown)
