"""Closed loops of critics that are not quadratic, on the linear and on the nonlinear plant.

A policy u costs J = V* + ∫ (u - u*)'R (u - u*) - δ² (d - d*)'(d - d*) dt, and in discrete time a
sum over the steps (`running_suboptimality`). The worst disturbance is that of u = -K z.

All flights of a loop are simulated at once, one in each row.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.network.operations import RowNetwork, row_function
from controller.riccati.gare import Solution
from controller.riccati.suboptimality import Suboptimality, reference_cost
from hfa_aircraft.batch_simulation import (
    FAR_OF_VALUE,
    OF_EXACT,
    OF_VALUE,
    FlightOutcome,
    has_decayed,
)
from hfa_support.matrices import quadratic_forms, spectral_abscissa
from hfa_support.native.bound import RowFunction
from hfa_support.reporting.report import Check, at_most
from hfa_support.reporting.text import percent
from verification.box import NonlinearPlant, starts_in
from verification.verdict import CounterExample

#: A tick of a simulation in continuous time is as long as the slowest linear loop needs to decay to
#: exp(-`DECAY`). A loop that is more than `SLOWEST` times slower than the exact one counts as that
#: fast.
DECAY = 5.0
SLOWEST = 100.0
#: Largest number of ticks of a simulation in continuous time: 500 time constants of the linear
#: loop.
TICKS = 100
#: Largest number of steps of a simulation, LSODA's or those of a discrete loop, and that of the
#: nonlinear plant.
STEPS = 8000
FEW_STEPS = 2000
#: Number of steps of a discrete loop in a tick.
_STEPS_PER_TICK = 100
#: Largest number of Newton steps to an equilibrium, and its largest distance, in boxes.
_NEWTON_STEPS = 30
_FARTHEST_EQUILIBRIUM = 100.0
#: Error of a step of LSODA, relative to a number, and to its size in the box: three digits of costs
#: are printed, also of a ten-thousandth of the optimum.
_RELATIVE_ACCURACY, _ACCURACY_IN_BOX = 1e-7, 1e-9
#: A last Newton step, relative to the box, after which only rounding changes the equilibrium.
_SETTLED_STEP = 1e-12


class End(NamedTuple):
    """End of the flights of a loop.

    outcome: CONVERGED if all flights converge, LEFT if one diverges, otherwise UNDECIDED, by the
        end of the clock
    times: durations, s or steps, (N,)
    z: last states, (N, n), minus the equilibrium unless a flight diverges or there is none
    costs: (N,)
    failed: number of a flight that diverges or has not converged; 0 if all converge
    """

    outcome: FlightOutcome
    times: np.ndarray
    z: np.ndarray
    costs: np.ndarray
    failed: int = 0


#: Function of states z (N, n) -> rows (N, n + 1) of z' or z⁺ and of the cost.
Dynamics = Callable[[np.ndarray], np.ndarray]


class Rates:
    """Simulator of z' = f(z), by LSODA with error control.

    dynamics: f and the rate of the cost
    largest: V* = z'P z above which a flight diverges
    P: (n, n)
    sizes: sizes of the states and of the cost, to which errors are relative, (n + 1,)
    tick: duration of a tick, s; the longest flight has `TICKS` of them
    most_steps: largest number of steps of LSODA in a simulation
    """

    def __init__(
        self,
        dynamics: Dynamics,
        largest: float,
        P: np.ndarray,
        sizes: np.ndarray,
        tick: float,
        most_steps: int,
    ) -> None:
        self.tick = tick
        self.longest = TICKS * tick
        self.most_steps = most_steps
        self._dynamics = dynamics
        self._largest = largest
        self._P = P
        self._sizes = sizes

    def after(self, rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        """Return the rows [z, cost], (N, n + 1), after a tick, nan where a flight diverges, and the
        number of LSODA's steps: 0 if the tick fails or takes more than `most`.
        """
        from scipy.integrate import odeint

        # The distance of each flight, in boxes: tolerances decrease with a flight that converges.
        distances = np.abs(rows / self._sizes).max(axis=1, keepdims=True)
        half_bandwidth = rows.shape[1] - 1  # of a block-diagonal Jacobian: flights are independent

        diverging = rows.copy()

        def rates(numbers: np.ndarray, _: float) -> np.ndarray:
            z = numbers.reshape(rows.shape)[:, :-1]
            is_far = ~((z @ self._P * z).sum(axis=1) <= self._largest)  # too large, or nan
            if is_far.any():
                diverging[is_far] = np.nan
                raise FloatingPointError
            return self._dynamics(z).ravel()

        try:
            with warnings.catch_warnings(action="ignore"):  # of LSODA when it fails
                (_, reached), report = odeint(
                    rates,
                    rows.ravel(),
                    [0.0, self.tick],
                    full_output=True,
                    ml=half_bandwidth,
                    mu=half_bandwidth,
                    rtol=_RELATIVE_ACCURACY,
                    atol=(_ACCURACY_IN_BOX * distances * self._sizes).ravel(),
                    mxstep=most,
                )
        except FloatingPointError:
            return diverging, 0
        if report["message"] != "Integration successful.":
            return rows, 0
        return reached.reshape(rows.shape), int(report["nst"][-1])


class Steps:
    """Simulator of z⁺ = f(z), whose cost is the sum of αᵏ times that of step k.

    dynamics: f and the cost of the step
    discount: α
    """

    def __init__(self, dynamics: Dynamics, discount: float) -> None:
        self.most_steps = STEPS
        self.tick = float(_STEPS_PER_TICK)
        self.longest = float(STEPS)
        self._dynamics = dynamics
        self._discount = discount

    def after(self, rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        """Return the rows after a tick, and the number of its steps."""
        z, total = rows[:, :-1], rows[:, -1].copy()
        with np.errstate(all="ignore"):
            for step in range(_STEPS_PER_TICK):
                after = self._dynamics(z)
                z = after[:, :-1]
                total += self._discount ** (time + step) * after[:, -1]
        return np.column_stack([z, total]), _STEPS_PER_TICK


@dataclass(frozen=True, eq=False)
class Loop:
    """Closed loop of z and of its cost.

    A flight ends when V* = z'Pz has decreased to `OF_VALUE` of its first value, when it has
    increased beyond `largest`, or when the clock ends.

    simulator: of the rows [z, cost]
    P: matrix of V*, (n, n)
    equilibrium: equilibrium near z = 0, (n,), or None if none is found
    largest: V* above which the loop diverges
    exact_step: matrix of the exact loop in discrete time, (n, n), or None. A slow loop also
        converges if V* is at most `OF_EXACT` times that of the exact loop at the end of the clock
    """

    simulator: Rates | Steps
    P: np.ndarray
    equilibrium: np.ndarray | None
    largest: float
    exact_step: np.ndarray | None = None

    def simulate(self, starts: np.ndarray) -> End:
        """Simulate the flights from initial states (N, n), until one diverges.

        Without an equilibrium, nothing is decided.
        """
        rows = np.column_stack([starts, np.zeros(len(starts))])
        times = np.zeros(len(starts))
        if self.equilibrium is None:
            return End(FlightOutcome.UNDECIDED, times, rows[:, :-1], rows[:, -1])
        initial = self._value(starts - self.equilibrium)
        flying = np.arange(len(starts))  # rows of flights that have not converged
        time, steps_left = 0.0, self.simulator.most_steps
        while flying.size and steps_left > 0 and time < self.simulator.longest:
            rows[flying], steps = self.simulator.after(rows[flying], time, steps_left)
            is_far = ~(self._value(rows[:, :-1]) <= self.largest)  # or nan
            if is_far.any():
                far = int(np.argmax(is_far))
                return End(FlightOutcome.LEFT, times, rows[:, :-1], rows[:, -1], far)
            if not steps:  # the tick takes more steps than are left
                break
            steps_left -= steps
            time += self.simulator.tick
            times[flying] = time
            now = self._value(rows[flying, :-1] - self.equilibrium)
            flying = flying[~has_decayed(now, initial[flying], OF_VALUE)]
        z = rows[:, :-1] - self.equilibrium
        if self.exact_step is not None and flying.size:
            # Where the exact loop is as slow, a flight counts as converged.
            exact_steps = np.linalg.matrix_power(self.exact_step, round(time))
            z_of_exact = (starts[flying] - self.equilibrium) @ exact_steps.T
            has_converged = has_decayed(self._value(z[flying]), self._value(z_of_exact), OF_EXACT)
            flying = flying[~has_converged]
        outcome = FlightOutcome.UNDECIDED if flying.size else FlightOutcome.CONVERGED
        return End(outcome, times, z, rows[:, -1], int(flying[0]) if flying.size else 0)

    def _value(self, z: np.ndarray) -> np.ndarray:
        """Return V* of states z (N, n), (N,)."""
        with np.errstate(all="ignore"):
            return quadratic_forms(z, self.P)


def worst_loop(
    exact: Solution,
    critic: Critic,
    disturbance_gain: np.ndarray,
    b: np.ndarray,
    equilibrium: np.ndarray | None,
) -> Loop:
    """Return the closed loop with the exact disturbance and a gain above it, and its cost J - V*.

    Inputs and disturbances count from their values at the equilibrium.

    disturbance_gain: gain of the disturbance above the exact one, (k, n)
    b: half-widths of the box of states, (n,)
    """
    game = exact.game
    by_disturbance = game.E @ (exact.L + disturbance_gain)
    A = game.A + by_disturbance
    policy = policy_of_rows(critic)
    at_rest = np.zeros(len(b)) if equilibrium is None else equilibrium
    u_at_rest = policy(at_rest[None])[0]
    H = weights_of_deviations(exact, disturbance_gain)

    def dynamics(z: np.ndarray) -> np.ndarray:
        u, deviation = policy(z), z - at_rest
        a = np.hstack([u - u_at_rest + deviation @ exact.K.T, deviation @ disturbance_gain.T])
        after = z @ game.A.T + u @ game.B.T + deviation @ by_disturbance.T
        return np.column_stack([after, (a @ H * a).sum(axis=1)])

    if game.is_discrete:
        return Loop(
            Steps(dynamics, game.discount),
            P=exact.P,
            equilibrium=equilibrium,
            largest=_diverging_value(exact, b),
            exact_step=A - game.B @ exact.K,
        )
    # The slowest of the loops without and with the disturbance counts.
    tick = _tick(exact, *(open_loop - game.B @ critic.K for open_loop in (game.A, A)))
    return _flow_loop(exact, dynamics, equilibrium, tick, b, STEPS)


def policy_of_rows(critic: Critic) -> RowNetwork:
    """Return the policy for rows z (N, n) -> u (N, m)."""
    listed = None if critic.on_vectors is None else row_function(critic.on_vectors)
    return listed or critic.u


def equilibrium_of(
    exact: Solution, critic: Critic, b: np.ndarray, start: np.ndarray | None = None
) -> np.ndarray | None:
    """Return the equilibrium of a policy without a disturbance, (n,), or None if none is found.

    start: from which it is searched, by default 0
    """
    game, z = exact.game, critic.symbols
    after = ca.DM(game.A) @ z + ca.DM(game.B) @ critic.policy(z)
    return newton_equilibrium(z, after - z if game.is_discrete else after, b, start)


def plant_loop(
    exact: Solution, plant: NonlinearPlant, critic: Critic | None, b: np.ndarray
) -> Loop:
    """Return the closed loop of the nonlinear plant with its saturated inputs, without cost.

    critic: the critic, or None for the exact policy
    b: half-widths of the box of states, (n,)
    """
    game, judged = exact.game, critic or Critic(exact.K)
    z = judged.symbols
    rates = plant.closed(z, judged.policy(z))
    closed = ca.Function("closed", [z], [ca.densify(ca.vertcat(rates, 0.0))], {"cse": True})
    rows = RowFunction(closed)
    tick, equilibrium = _tick(exact, game.A - game.B @ judged.K), newton_equilibrium(z, rates, b)
    return _flow_loop(exact, lambda z: rows(z)[0], equilibrium, tick, b, FEW_STEPS)


def _flow_loop(
    exact: Solution,
    dynamics: Dynamics,
    equilibrium: np.ndarray | None,
    tick: float,
    b: np.ndarray,
    most_steps: int,
) -> Loop:
    """Return a closed loop in continuous time; tick, most_steps: as for `Rates`."""
    far = _diverging_value(exact, b)
    sizes = np.append(b, far / FAR_OF_VALUE)  # the cost is as large as V* in the box
    simulator = Rates(dynamics, far, exact.P, sizes, tick, most_steps)
    return Loop(simulator, P=exact.P, equilibrium=equilibrium, largest=far)


def _diverging_value(exact: Solution, b: np.ndarray) -> float:
    """Return V* above which a flight counts as diverging: `FAR_OF_VALUE` times that of the box."""
    return FAR_OF_VALUE * float(b @ np.abs(exact.P) @ b)


def _tick(exact: Solution, *loops: np.ndarray) -> float:
    """Return the time, s, in which the exact loop and other linear loops decay to exp(-`DECAY`).

    loops: matrices (n, n); one that is more than `SLOWEST` times slower counts as that slow
    """
    game = exact.game
    of_exact, *rates = (
        abs(spectral_abscissa(loop)) for loop in (game.A - game.B @ exact.K, *loops)
    )
    return DECAY / max(min([of_exact, *rates]), of_exact / SLOWEST)


def weights_of_deviations(exact: Solution, M: np.ndarray) -> np.ndarray:
    """Return H of the rate a'H a at which a policy costs more than the exact policy.

    a = (u + K z, M z) are the deviations of both players from their exact policies. H is
    [R 0; 0 -δ²], in discrete time plus α [B E]'P [B E].

    exact: exact solution, with the policy u* = -K z and the value z'P z
    M: gain of the disturbance above the exact one, (k, n)
    """
    game = exact.game
    weight, cross = exact.suboptimality_weight, np.zeros((len(game.R), len(M)))
    delta_squared = game.delta**2 if M.any() else 0.0  # δ may be infinite without a disturbance
    of_disturbance = -delta_squared * np.eye(len(M))
    if game.is_discrete:
        ahead = game.discount * exact.P @ game.E
        cross = game.B.T @ ahead
        of_disturbance = of_disturbance + game.E.T @ ahead
    return np.block([[weight, cross], [cross.T, of_disturbance]])


def newton_equilibrium(
    z: ca.SX, rates: ca.SX, b: np.ndarray, start: np.ndarray | None = None
) -> np.ndarray | None:
    """Return the equilibrium z (n,) that Newton's method finds from a state, by default 0, or None.

    The result is None without convergence. The iterates must stay within
    |z_i| <= `_FARTHEST_EQUILIBRIUM` b_i.

    z: symbols, (n,)
    rates: expression of z', or of z⁺ - z, in these symbols, (n,)
    b: half-widths of the box, (n,)
    """
    step = ca.Function("step", [z], [rates, ca.jacobian(rates, z)])
    point = np.zeros(len(b)) if start is None else start
    for _ in range(_NEWTON_STEPS):
        rate, jacobian = (np.array(part) for part in step(point))
        if not (np.all(np.isfinite(rate)) and np.all(np.isfinite(jacobian))):
            return None
        try:
            change = np.linalg.solve(jacobian, rate.ravel())
        except np.linalg.LinAlgError:
            return None
        point = point - change
        if np.any(np.abs(point) > _FARTHEST_EQUILIBRIUM * b):
            return None
        if np.all(np.abs(change) <= _SETTLED_STEP * b):
            return point
    return None


#: Number of initial conditions in the search for the largest box, and k of its multiples
#: 2^-k ... 2^k.
FEW = 6
DOUBLINGS = 4
#: Distance of another equilibrium, relative to the box.
_ELSEWHERE = 1e-3
#: Change of the state in a tick, relative to its distance from the equilibrium, at which a flight
#: that does not converge has come to rest elsewhere.
_AT_REST = 1e-6
#: Most steps back along the exact loop from a violator into the box, per rate of its fastest mode.
_STEPS_BACK, _STEPS_PER_RATE = 400, 50.0


class FlightResults(NamedTuple):
    """Results of simulations of a critic that is not quadratic.

    The fields are named as in the JSON output. A tested multiple of the box is a power of two. The
    loop converges from all smaller tested multiples too.

    flights: number of initial conditions, or 0 if nothing was simulated.
    cost_above_optimum_flown_percent: largest cost above V*, in percent of the `reference_cost`; inf
        if a simulation diverges or ends at another equilibrium, nan if one is not decided at the
        end of its clock. For a linear policy, it is the largest suboptimality over all initial
        conditions.
    cost_above_optimum_flown_mean_percent: mean cost above V* in percent of it, or inf or nan.
    undecided_at: end of the clock of the simulation that is not decided, s or steps, or None.
    worst: the flight with the largest cost, or None if nothing was simulated or is not decided.
    rest_point: (n,), equilibrium of the policy on the linear plant, or None.
    equilibrium_cost: cost of the equilibrium per second, or per discrete step; 0 at the trim.
    reach_nonlinear: largest tested multiple of the box from which the loop converges on the
        nonlinear plant, 0 for none, or None without such a plant.
    reach_nonlinear_exact: `reach_nonlinear` of the exact policy, or None without such a plant.
    """

    flights: int = 0
    cost_above_optimum_flown_percent: float = math.inf
    cost_above_optimum_flown_mean_percent: float = math.inf
    undecided_at: float | None = None
    worst: CounterExample | None = None
    rest_point: np.ndarray | None = None
    equilibrium_cost: float = 0.0
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
    suboptimality: Suboptimality,
    b: np.ndarray,
    flights: int,
    equilibrium: np.ndarray | None,
    violators: Sequence[np.ndarray] = (),
    plant: NonlinearPlant | None = None,
) -> FlightResults:
    """Simulate a critic that is not quadratic from the box |z_i| <= b_i.

    Flights first begin where the exact loop comes to a violator, under the worst disturbance of the
    exact loop. The others are under that of the critic's linear part, u = -K z, if it is stable.

    suboptimality: cost of the policy u = -K z above the optimum
    flights: number of initial conditions, 0 for no simulation
    equilibrium: of the policy, or None
    violators: deviations from the equilibrium at which the error of the policy is too large
    plant: nonlinear plant of a critic in continuous time, or None
    """
    if not (flights and critic.is_finite):
        return FlightResults()
    starts = [start for at in violators if (start := _start_towards(exact, at, b)) is not None]
    results = None
    if starts and equilibrium is not None:
        loop = worst_loop(exact, critic, 0.0 * exact.L, b, equilibrium)
        results = _flown(exact, loop, np.array(starts) + equilibrium, b, 0.0 * exact.P)
        if not math.isinf(results.cost_above_optimum_flown_percent):
            results = _other_equilibrium(exact, critic, b, equilibrium, violators)
    remaining = suboptimality.matrix
    if results is None and suboptimality.is_stable and remaining is not None:
        loop = worst_loop(exact, critic, suboptimality.disturbance_gain, b, equilibrium)
        # The worst state is nan or 0 if all cost the same; a corner of the box then stands for it.
        worst = suboptimality.worst if np.any(np.nan_to_num(suboptimality.worst)) else b
        chosen = [worst, *starts][:flights]
        all_starts = np.vstack([*chosen, starts_in(b, flights - len(chosen))])
        results = _flown(exact, loop, all_starts, b, remaining)
    if results is None:
        return FlightResults()
    few = min(FEW, flights)
    on_plant: list[float | None] = [None, None]  # reach of the critic, and of the exact policy
    if plant is not None:
        policies = (critic, None)
        on_plant = [_reach(plant_loop(exact, plant, each, b), b, few) for each in policies]
    return results._replace(
        reach_nonlinear=on_plant[0],
        reach_nonlinear_exact=on_plant[1],
    )


def _other_equilibrium(
    exact: Solution,
    critic: Critic,
    b: np.ndarray,
    equilibrium: np.ndarray,
    violators: Sequence[np.ndarray],
) -> FlightResults | None:
    """Return a flight that stays at another equilibrium in the box, found from the violators."""
    for at in violators:
        other = equilibrium_of(exact, critic, b, at + equilibrium)
        if other is None or (np.abs(other) > b).any():
            continue
        if (np.abs(other - equilibrium) > _ELSEWHERE * b).any():
            return FlightResults(1, worst=CounterExample(other, "stays there"))
    return None


def _start_towards(exact: Solution, z: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """Return a state of the box from which the exact loop comes to a state z, or None."""
    F = exact.game.A - exact.game.B @ exact.K
    if exact.game.is_discrete:
        back = np.linalg.pinv(F)
    else:
        from scipy.linalg import expm

        back = expm(-F / (_STEPS_PER_RATE * np.abs(np.linalg.eigvals(F)).max()))
    for _ in range(_STEPS_BACK):
        if (np.abs(z) <= b).all():
            return z
        z = back @ z
    return None


def _flown(
    exact: Solution, loop: Loop, starts: np.ndarray, b: np.ndarray, remaining: np.ndarray
) -> FlightResults:
    """Return the results of flights from initial states (N, n), of which the worst is shown.

    remaining: matrix of the cost above V* of the linear loop after the end of a flight, (n, n)
    """
    flights, end = len(starts), loop.simulate(starts)
    if end.outcome is FlightOutcome.CONVERGED:
        after_end = exact.game.discount**end.times * quadratic_forms(end.z, remaining)
        reference = reference_cost(exact.P, b)
        # Near 0, the error of a network is absolute: what counts is the optimum of the box.
        optima = np.maximum(quadratic_forms(starts, reference), reference[0, 0] * b[0] ** 2)
        with np.errstate(over="ignore"):  # where P is 0
            above = np.maximum(100.0 * (end.costs + after_end) / optima, 0.0)
        worst = CounterExample(starts[int(np.argmax(above))], "costs more")
        return FlightResults(flights, float(above.max()), float(above.mean()), worst=worst)
    start = starts[end.failed]
    if end.outcome is FlightOutcome.LEFT:
        return FlightResults(flights, worst=CounterExample(start, "diverges"))
    if loop.equilibrium is not None and _has_come_to_rest(loop, end):
        what = "stays away from the equilibrium"
        return FlightResults(flights, worst=CounterExample(start, what))
    return FlightResults(flights, math.nan, math.nan, undecided_at=float(end.times.max()))


def _has_come_to_rest(loop: Loop, end: End) -> bool:
    """Return whether the flight that has not converged hardly moves in a further tick."""
    assert loop.equilibrium is not None
    z = end.z[[end.failed]]
    row = np.column_stack([z + loop.equilibrium, [0.0]])
    most = loop.simulator.most_steps
    after, steps = loop.simulator.after(row, float(end.times[end.failed]), most)
    return bool(steps and np.abs(after - row)[:, :-1].max() <= _AT_REST * np.abs(z).max())


def _reach(loop: Loop, b: np.ndarray, flights: int) -> float:
    """Return the largest tested multiple of the box from which `flights` flights converge, or 0."""

    def converges(size: float) -> bool:
        """Return whether all flights from a multiple of the box converge."""
        starts = size * starts_in(b, flights)
        first, others = starts[:1], starts[1:]  # if the first, a corner, fails, no others fly
        return all(
            loop.simulate(flown).outcome is FlightOutcome.CONVERGED
            for flown in (first, others)
            if len(flown)
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
