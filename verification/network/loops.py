"""Flights of critics that are not quadratic, on the linear plant.

A policy u = -K z + e costs J = V* + ∫ e'R e dt under the worst disturbance of the exact game, where
states and inputs count from an equilibrium of the policy; in discrete time it is the sum over the
steps, with R + α B'P B in place of R.

All flights of a loop are simulated at once, one in each row [z, cost].
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.network.operations import row_function
from controller.riccati.gare import Solution
from controller.riccati.suboptimality import reference_cost
from hfa_aircraft.batch_simulation import FAR_OF_VALUE, OF_VALUE, has_decayed
from hfa_support.matrices import quadratic_forms, spectral_abscissa
from hfa_support.reporting.report import Check, at_most
from hfa_support.reporting.text import percent
from verification.box import starts_in
from verification.verdict import CounterExample

#: A tick of a simulation in continuous time is as long as the exact loop needs to decay to
#: exp(-`_DECAY`). The longest flight has `_TICKS`: 500 time constants.
_DECAY, _TICKS = 5.0, 100
#: Largest number of steps of a simulation, LSODA's or those of a discrete loop, and number of the
#: latter in a tick.
_STEPS, _STEPS_PER_TICK = 20_000, 100
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
#: Distances of starts beside one, relative to the box.
_BESIDE = (-1e-7, 1e-7)

#: Rows [z, cost] (N, n + 1), their time, s or steps, and the steps left -> rows after a tick, and
#: the number of its steps: 0 if it needs more.
_Tick = Callable[[np.ndarray, float, int], tuple[np.ndarray, int]]


class End(NamedTuple):
    """End of flights.

    z: last deviations from the equilibrium, (N, n)
    costs: (N,)
    time: s or steps
    failed: number of a flight that diverges or has not converged, or None if all converge
    diverges: whether it diverges
    """

    z: np.ndarray
    costs: np.ndarray
    time: float
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
        """Return the rows after a tick of z⁺ = f(z), and the number of its steps."""
        for step in range(_STEPS_PER_TICK):
            after = rates(rows[:, :-1])
            after[:, -1] = rows[:, -1] + game.discount ** (time + step) * after[:, -1]
            rows = after
        return rows, _STEPS_PER_TICK

    period, longest = float(_STEPS_PER_TICK), float(_STEPS)
    after: _Tick = steps
    if not game.is_discrete:
        period = _DECAY / abs(spectral_abscissa(game.A - game.B @ K))
        longest, after = (
            _TICKS * period,
            _flow(rates, is_far, np.append(b, size), period, longest_step),
        )
    rows = np.column_stack([starts - equilibrium, np.zeros(len(starts))])
    flying = np.arange(len(starts))  # rows of flights that have not converged
    initial, time, left = quadratic_forms(rows[:, :-1], exact.P), 0.0, _STEPS
    with np.errstate(all="ignore"):
        while flying.size and left > 0 and time < longest:
            rows[flying], taken = after(rows[flying], time, left)
            if (far := is_far(rows)).any():
                return End(rows[:, :-1], rows[:, -1], time, int(np.argmax(far)), diverges=True)
            left = left - taken if taken else 0
            time += period
            now = quadratic_forms(rows[flying, :-1], exact.P)
            flying = flying[~has_decayed(now, initial[flying], OF_VALUE)]
    return End(rows[:, :-1], rows[:, -1], time, int(flying[0]) if flying.size else None)


def _flow(
    rates: Callable[[np.ndarray], np.ndarray],
    is_far: Callable[[np.ndarray], np.ndarray],
    sizes: np.ndarray,
    period: float,
    longest_step: float,
) -> _Tick:
    """Return the tick of z' = f(z), by LSODA with error control.

    sizes: of the states and of the cost, to which errors are relative, (n + 1,)
    """

    def after(rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        from scipy.integrate import odeint

        # The distance of each flight, in boxes: tolerances decrease with a flight that converges.
        distances = np.abs(rows / sizes).max(axis=1, keepdims=True)
        half_bandwidth = rows.shape[1] - 1  # of a block-diagonal Jacobian: flights are independent

        def flat(numbers: np.ndarray, _: float) -> np.ndarray:
            """Return the rates; a flight that diverges stops."""
            now = numbers.reshape(rows.shape)
            return np.where(is_far(now)[:, None], 0.0, rates(now[:, :-1])).ravel()

        with warnings.catch_warnings(action="ignore"):  # of LSODA when it fails
            (_, reached), report = odeint(
                flat,
                rows.ravel(),
                [0.0, period],
                full_output=True,
                ml=half_bandwidth,
                mu=half_bandwidth,
                rtol=_RELATIVE_ACCURACY,
                atol=(_ACCURACY_IN_BOX * distances * sizes).ravel(),
                hmax=longest_step * period,
                mxstep=most,
            )
        if report["message"] != "Integration successful.":
            return rows, 0
        return reached.reshape(rows.shape), int(report["nst"][-1])

    return after


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
        if a simulation diverges or there is another equilibrium, nan if one is not decided at the
        end of its clock.
    undecided_at: end of the clock of the simulation that is not decided, s or steps, or None.
    worst: the flight with the largest cost, or None if nothing was simulated or is not decided.
    rest_point: (n,), equilibrium of the policy on the linear plant, or None.
    equilibrium_cost: cost of the equilibrium per second, or per discrete step; 0 at the trim.
    """

    flights: int = 0
    cost_above_optimum_flown_percent: float = math.inf
    undecided_at: float | None = None
    worst: CounterExample | None = None
    rest_point: np.ndarray | None = None
    equilibrium_cost: float = 0.0


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
    share, reason = math.inf, "no equilibrium near trim"
    if equilibrium is not None:
        cost = float(equilibrium @ P @ equilibrium)
        share = 100.0 * cost / float(np.diag(P) @ b**2) if cost > 0.0 else 0.0
        distance = float((np.abs(equilibrium) / b).max())
        reason = f"equilibrium {distance:.2g} boxes off trim, V* there {percent(share, up=True)}"
    return at_most("rest_point", share, 100.0 * limit**2, reason, kind="rest")


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
            return end, end.failed, math.nan
        # Near 0, the error of a network is absolute: what counts is the optimum of the box.
        optima = np.maximum(quadratic_forms(starts, reference), reference[0, 0] * b[0] ** 2)
        with np.errstate(over="ignore"):  # where P is 0
            above = 100.0 * end.costs / optima
        return end, int(np.argmax(above)), float(above.max())

    chosen = [worst] if np.any(np.nan_to_num(worst)) else []
    for violator in violators:
        chosen.append(np.clip(equilibrium + violator, -b, b))
        if (other := other_near(violator)) is not None:
            chosen += [np.clip(other + side * b, -b, b) for side in _BESIDE]
    starts = np.vstack([*chosen, starts_in(b, flights)])[:flights]
    # Common steps of many flights are too long for a thin error that acts on few of them.
    groups = [group for group in np.split(starts, [len(chosen)]) if len(group)]
    shown, most = starts[0], -math.inf
    for group in groups:
        end, place, cost = flown(group)
        if not cost <= most:  # or nan
            shown, most = group[place], cost
        if end.failed is not None:
            break
    again, _, cost = flown(shown[None], _LONGEST_STEP)
    if again.diverges:
        return FlightResults(flights, worst=CounterExample(shown, "diverges"))
    if again.failed is not None and other_near(again.z[0]) is not None:
        return FlightResults(flights, worst=CounterExample(shown, "ends at another equilibrium"))
    if math.isnan(cost + most):
        return FlightResults(flights, math.nan, undecided_at=max(end.time, again.time))
    return FlightResults(flights, cost, worst=CounterExample(shown, "costs more"))
