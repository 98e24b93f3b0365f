"""Closed loops of critics that are not quadratic, on the linear and on the nonlinear plant.

A policy u costs J = V* + ∫ (u - u*)'R (u - u*) - δ² (d - d*)'(d - d*) dt, and in discrete time a
sum over the steps (`running_suboptimality`). The worst disturbance is that of u = -K z.

All flights of a loop are simulated at once, one in each row.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
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
from hfa_support.native.bound import BoundFunction, of_rows
from hfa_support.reporting.report import Check, at_most
from hfa_support.reporting.text import percent
from verification.box import NonlinearPlant, starts_in

#: A tick of a simulation in continuous time is as long as the slowest linear loop needs to decay to
#: exp(-`DECAY`). A loop that is more than `SLOWEST` times slower than the exact one counts as that
#: fast.
DECAY = 5.0
SLOWEST = 100.0
#: Largest number of ticks of a simulation in continuous time: 500 time constants of the linear
#: loop.
TICKS = 100
#: Largest number of steps of a simulation, LSODA's or those of a discrete loop, and that of a loop
#: that is slow to evaluate (a wide network, the nonlinear plant).
STEPS = 20_000
FEW_STEPS = 2000
#: Number of flights from which each operation is applied to all of them: a third of the time.
_MANY_ROWS = 24
#: Number of steps of a discrete loop in a tick, unless it is slow.
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
    """

    outcome: FlightOutcome
    times: np.ndarray
    z: np.ndarray
    costs: np.ndarray


class Simulator(Protocol):
    """How rows [z, cost] of flights change in a tick.

    tick: duration, s or steps
    longest: duration of the longest flight, s or steps
    most_steps: largest number of steps of a simulation
    """

    tick: float
    longest: float
    most_steps: int

    def after(self, rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        """Return the rows after a tick, nan where a flight diverges, and the number of its steps.

        If the tick fails or takes more than `most` steps, the rows are unchanged and the number is
        0.

        rows: (N, n + 1)
        time: when the tick begins
        """


class Rates:
    """Simulator of z' = f(z), by LSODA with error control.

    closed: Function [z; cost] -> (its rate, V*)
    largest: V* above which a flight diverges
    sizes: sizes of the states and of the cost, to which errors are relative, (n + 1,)
    tick: duration of a tick, s; the longest flight has `TICKS` of them
    most_steps: largest number of steps of LSODA in a simulation
    """

    def __init__(
        self,
        closed: ca.Function,
        largest: float,
        sizes: np.ndarray,
        tick: float,
        most_steps: int,
    ) -> None:
        self.tick = tick
        self.longest = TICKS * tick
        self.most_steps = most_steps
        self._closed = closed
        self._largest = largest
        self._sizes = sizes

    def after(self, rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        """Return the rows after a tick, and the number of LSODA's steps."""
        from scipy.integrate import odeint

        # The distance of each flight, in boxes: tolerances decrease with a flight that converges.
        distances = np.abs(rows / self._sizes).max(axis=1, keepdims=True)
        half_bandwidth = rows.shape[1] - 1  # of a block-diagonal Jacobian: flights are independent
        # The loops of all flights as one function, and the order of its numbers in memory.
        function, order = of_rows(self._closed, len(rows), len(rows) >= _MANY_ROWS)
        bound = BoundFunction(function)
        # Views of the function's own memory: an evaluation copies no array.
        state, rate = (
            memory.reshape(rows.shape, order=order)
            for memory in (bound.inputs[0], bound.results[0])
        )

        def rates(numbers: np.ndarray, _: float) -> np.ndarray:
            state[:] = numbers.reshape(rows.shape)
            bound.evaluate()
            if not (bound.results[1] <= self._largest).all():  # V* is too large, or nan
                raise FloatingPointError
            return rate.ravel()

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
            return np.full(rows.shape, np.nan), 0
        if report["message"] != "Integration successful.":
            return rows, 0
        return reached.reshape(rows.shape), int(report["nst"][-1])


class Steps:
    """Simulator of z⁺ = f(z), whose cost is the sum of αᵏ times that of step k.

    closed: Function z -> (z⁺, cost of the step)
    discount: α
    """

    def __init__(self, closed: ca.Function, discount: float, *, is_slow: bool) -> None:
        self.most_steps = FEW_STEPS if is_slow else STEPS
        self.tick = 1.0 if is_slow else float(_STEPS_PER_TICK)
        self.longest = float(self.most_steps)
        self._closed = closed
        self._discount = discount

    def after(self, rows: np.ndarray, time: float, most: int) -> tuple[np.ndarray, int]:
        """Return the rows after a tick, and the number of its steps."""
        bound = BoundFunction(self._closed.map(len(rows)))
        z, total = rows[:, :-1].ravel(), rows[:, -1].copy()
        with np.errstate(all="ignore"):
            for step in range(int(self.tick)):
                z, cost = bound.at(z)
                total += self._discount ** (time + step) * cost
        return np.column_stack([z.reshape(len(rows), -1), total]), int(self.tick)


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

    simulator: Simulator
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
            if not (self._value(rows[flying, :-1]) <= self.largest).all():  # far away, or nan
                return End(FlightOutcome.LEFT, times, rows[:, :-1], rows[:, -1])
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
        return End(outcome, times, z, rows[:, -1])

    def _value(self, z: np.ndarray) -> np.ndarray:
        """Return V* of states z (N, n), (N,)."""
        with np.errstate(all="ignore"):
            return quadratic_forms(z, self.P)


def worst_loop(
    exact: Solution, critic: Critic, suboptimality: Suboptimality, b: np.ndarray
) -> Loop:
    """Return the closed loop under the worst disturbance of u = -K z, the critic's linear part.

    The cost is J - V*. Inputs and disturbances count from their values at the equilibrium.

    suboptimality: of u = -K z, with the gain of its disturbance above the optimum
    b: half-widths of the box of states, (n,)
    """
    A = exact.game.A + exact.game.E @ (exact.L + suboptimality.disturbance_gain)
    return _linear_loop(exact, A, critic, b, suboptimality.disturbance_gain)


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
    tick, equilibrium = _tick(exact, game.A - game.B @ judged.K), newton_equilibrium(z, rates, b)
    return _flow_loop(exact, z, ca.vertcat(rates, 0.0), equilibrium, tick, b, FEW_STEPS)


def _linear_loop(
    exact: Solution,
    A: np.ndarray,
    critic: Critic,
    b: np.ndarray,
    disturbance_gain: np.ndarray | None = None,
) -> Loop:
    """Return the loop z' = A z + B u of a policy, in discrete time z⁺, with the cost J - V*.

    A: (n, n), with the worst disturbance or without one
    b: half-widths of the box of states, (n,)
    disturbance_gain: gain of the disturbance minus that of the exact one, (k, n); None for a loop
        without cost
    """
    game, z = exact.game, critic.symbols
    u = critic.policy(z)
    dynamics = ca.DM(A) @ z + ca.DM(game.B) @ u  # z', or z⁺ in discrete time
    residual = dynamics - z if game.is_discrete else dynamics  # 0 at an equilibrium
    equilibrium = newton_equilibrium(z, residual, b)
    cost = type(z)(0.0)
    if disturbance_gain is not None and equilibrium is not None:
        deviation, u_deviation = z - ca.DM(equilibrium), u - ca.DM(critic.u(equilibrium))
        cost = running_suboptimality(exact, disturbance_gain, deviation, u_deviation)
    is_slow = not isinstance(z, ca.SX)  # a wide network is an MX function
    if game.is_discrete:
        step = ca.Function("step", [z], [ca.densify(dynamics), ca.densify(cost)], {"cse": True})
        return Loop(
            Steps(step, game.discount, is_slow=is_slow),
            P=exact.P,
            equilibrium=equilibrium,
            largest=_diverging_value(exact, b),
            exact_step=A - game.B @ exact.K,
        )
    # The slower of the loops without and with the disturbance counts.
    tick = _tick(exact, *(open_loop - game.B @ critic.K for open_loop in (game.A, A)))
    rates, most_steps = ca.vertcat(dynamics, cost), FEW_STEPS if is_slow else STEPS
    return _flow_loop(exact, z, rates, equilibrium, tick, b, most_steps)


def _flow_loop(
    exact: Solution,
    z: ca.SX,
    rates: ca.SX,
    equilibrium: np.ndarray | None,
    tick: float,
    b: np.ndarray,
    most_steps: int,
) -> Loop:
    """Return a closed loop in continuous time.

    z, rates: symbols of the state, and the rates of state and cost as expressions of them
    tick, most_steps: as for a `Simulator`
    """
    value = ca.bilin(ca.DM(exact.P), z, z)
    both = ca.vertcat(z, type(z).sym("cost"))
    function = ca.Function("closed", [both], [ca.densify(rates), value], {"cse": True})
    far = _diverging_value(exact, b)
    sizes = np.append(b, far / FAR_OF_VALUE)  # the cost is as large as V* in the box
    simulator = Rates(function, far, sizes, tick, most_steps)
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


def running_suboptimality(exact: Solution, M: np.ndarray, z: ca.SX, u: ca.SX) -> ca.SX:
    """Return the rate a'H a at which a policy costs more than the exact policy.

    a = (u + K z, M z) are the deviations of both players from their exact policies. H is
    [R 0; 0 -δ²], in discrete time plus α [B E]'P [B E].

    exact: exact solution, with the policy u* = -K z and the value z'P z
    M: gain of the disturbance above the exact one, (k, n)
    z, u: state and input minus those at the equilibrium
    """
    game = exact.game
    weight, cross = exact.suboptimality_weight, np.zeros((len(game.R), len(M)))
    delta_squared = game.delta**2 if M.any() else 0.0  # δ may be infinite without a disturbance
    of_disturbance = -delta_squared * np.eye(len(M))
    if game.is_discrete:
        ahead = game.discount * exact.P @ game.E
        cross = game.B.T @ ahead
        of_disturbance = of_disturbance + game.E.T @ ahead
    H = np.block([[weight, cross], [cross.T, of_disturbance]])
    a = ca.vertcat(u + ca.DM(exact.K) @ z, ca.DM(M) @ z)
    return ca.bilin(ca.DM(H), a, a)


def newton_equilibrium(z: ca.SX, rates: ca.SX, b: np.ndarray) -> np.ndarray | None:
    """Return the equilibrium z (n,) that Newton's method finds from z = 0, or None.

    The result is None without convergence. The iterates must stay within
    |z_i| <= `_FARTHEST_EQUILIBRIUM` b_i.

    z: symbols, (n,)
    rates: expression of z', or of z⁺ - z, in these symbols, (n,)
    b: half-widths of the box, (n,)
    """
    step = ca.Function("step", [z], [rates, ca.jacobian(rates, z)])
    point = np.zeros(len(b))
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
    cost_above_optimum_flown_percent: largest cost above V*, in percent of the `reference_cost`; inf
        if a simulation diverges, nan if one is not decided at the end of its clock. For a linear
        policy, it is the largest suboptimality over all initial conditions.
    cost_above_optimum_flown_mean_percent: mean cost above V* in percent of it, or inf or nan.
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
    cost_above_optimum_flown_percent: float = math.inf
    cost_above_optimum_flown_mean_percent: float = math.inf
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
    suboptimality: Suboptimality,
    b: np.ndarray,
    flights: int,
    plant: NonlinearPlant | None = None,
) -> FlightResults:
    """Simulate a critic that is not quadratic from the box |z_i| <= b_i.

    Nothing is simulated if the critic has non-finite values or its linear loop is unstable.

    suboptimality: cost of the policy u = -K z above the optimum
    flights: number of initial conditions. At most `_WIDE_FLIGHTS` are used for a wide network
    plant: nonlinear plant of a critic in continuous time, or None
    """
    game = exact.game
    if not (flights and critic.is_finite and suboptimality.is_stable):
        return FlightResults()
    if critic.is_wide:
        flights = min(flights, _WIDE_FLIGHTS)
    above, undecided_at = costs_above_optimum(exact, critic, suboptimality, b, flights)
    loop = _linear_loop(exact, game.A, critic, b)  # without disturbance and cost
    equilibrium_cost = 0.0
    if loop.equilibrium is not None:
        z_and_u = np.append(loop.equilibrium, critic.u(loop.equilibrium))
        equilibrium_cost = float(z_and_u @ game.weights @ z_and_u)
    few = min(FEW, flights)
    on_plant: list[float | None] = [None, None]  # reach of the critic, and of the exact policy
    if plant is not None:
        policies = (critic, None)
        on_plant = [_reach(plant_loop(exact, plant, each, b), b, few) for each in policies]
    return FlightResults(
        flights=flights,
        cost_above_optimum_flown_percent=float(above.max()),
        cost_above_optimum_flown_mean_percent=float(above.mean()),
        undecided_at=undecided_at,
        rest_point=loop.equilibrium,
        equilibrium_cost=equilibrium_cost,
        reach=_reach(loop, b, few),
        reach_nonlinear=on_plant[0],
        reach_nonlinear_exact=on_plant[1],
    )


def costs_above_optimum(
    exact: Solution, critic: Critic, suboptimality: Suboptimality, b: np.ndarray, flights: int
) -> tuple[np.ndarray, float | None]:
    """Return the cost above V* from each initial condition, in percent of the `reference_cost`,
    (flights,), and the end of the clock, s or steps, if a simulation is not decided, or None.

    The first initial condition is the worst one of the linear loop. The loop is under the worst
    disturbance of the critic's linear part. The cost after the end of a simulation is computed for
    the linear loop. All costs are inf if a simulation diverges or the linear loop has no bounded
    cost, and nan if a simulation is not decided.
    """
    remaining = suboptimality.matrix  # of the cost of u = -K z above V*
    if remaining is None:
        return np.full(flights, math.inf), None
    loop = worst_loop(exact, critic, suboptimality, b)
    # The worst state is nan or 0 if all cost the same; a corner of the box then stands for it.
    worst = suboptimality.worst if np.any(np.nan_to_num(suboptimality.worst)) else b
    starts = np.vstack([worst, starts_in(b, flights - 1)])
    end = loop.simulate(starts)
    if end.outcome is FlightOutcome.LEFT:
        return np.full(flights, math.inf), None
    if end.outcome is FlightOutcome.UNDECIDED:
        return np.full(flights, math.nan), float(end.times.max())
    after_end = exact.game.discount**end.times * quadratic_forms(end.z, remaining)
    with np.errstate(over="ignore"):  # where P is 0
        ratios = (end.costs + after_end) / quadratic_forms(starts, reference_cost(exact.P, b))
    return np.maximum(100.0 * ratios, 0.0), None


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
