"""Costs of many simulated flights to the trim, for the comparison with a proved lower bound."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.march.cost import Cost
from hfa_aircraft.march.march import saturated
from hfa_aircraft.march.steppers import rk4
from hfa_flight.initial_box import usual_box
from hfa_flight.problem import FlightProblem
from hfa_prove.statements.cost import CostStatement
from hfa_support.matrices import quadratic_forms
from hfa_support.native.bound import RowFunction
from hfa_support.native.machine_code import machine_code

#: Number of flights simulated together.
_AT_ONCE = 2000
#: Steps in the time constant of the fastest mode of the linear optimum, and longest flight in time
#: constants of its slowest mode.
_PER_FASTEST = 5.0
_OF_SLOWEST = 6.0
#: A flight has reached the trim if the linear cost of its state is below this fraction of its cost.
#: This is tested every `_LOOKED_AT` steps.
_CONVERGED = 1e-3
_LOOKED_AT = 50
#: Number of pulses in a flight, largest number of steps in each, and their nominal sizes.
_PULSES = 8
_PULSE = 60
_SIZES = (0.0, 0.1, 1.0)


class CostRatios(NamedTuple):
    """Costs of flights compared with a lower bound.

    flights: number of flights that end at the trim within the limits
    below: number of these flights that cost less than the bound
    least, median: smallest and median ratio of cost to bound
    """

    flights: int
    below: int
    least: float
    median: float


def cost_ratios(
    problem: FlightProblem, bound: CostStatement, flights: int, seed: int = 0
) -> CostRatios:
    """Return the costs of at least `flights` flights to the trim, compared with a lower bound.

    Half of the flights begin on the faces of the usual box. Pulses are added to the inputs. Three
    control laws are used in turn:
    - the inputs that minimize the running cost plus the rate of the bound, linearized in the inputs
    - the gain of the linear optimum
    - this gain with randomly scaled rows

    problem: flights to the trim
    bound: proved lower bound on their cost
    """
    random = np.random.default_rng(seed)
    half = usual_box(problem)
    m = len(problem.inputs)
    poles = np.linalg.eigvals(problem.linear.A - problem.linear.B @ problem.K)
    step = 1.0 / (_PER_FASTEST * np.abs(poles).max())
    most = int(_OF_SLOWEST / (step * np.abs(poles.real).min()))
    one_step = RowFunction(machine_code(step_function(problem, bound, step)))
    ratios = np.zeros(0)
    while len(ratios) < flights:
        z = random.uniform(-1.0, 1.0, (_AT_ONCE, len(half)))
        z[::2] /= np.abs(z[::2]).max(axis=1, keepdims=True)
        z = z * half
        way = np.arange(len(z)) % 3
        factors = np.where(way[:, None] == 2, random.uniform(0.5, 1.5, (len(z), m)), 1.0)
        sizes = random.choice(_SIZES, (len(z), 1)) * problem.sizes[1]
        pulses = random.uniform(-1.0, 1.0, (_PULSES, len(z), m)) * sizes
        settings = np.column_stack([way == 0, factors])
        costs = flight_costs(problem, one_step, z, settings, pulses, most)
        ended = np.isfinite(costs)
        ratios = np.concatenate([ratios, costs[ended] / bound.bound(z[ended])])
    below = int(np.sum(ratios < 1.0))
    return CostRatios(len(ratios), below, float(ratios.min()), float(np.median(ratios)))


def flight_costs(
    problem: FlightProblem,
    one_step: RowFunction,
    z: np.ndarray,
    settings: np.ndarray,
    pulses: np.ndarray,
    most: int,
) -> np.ndarray:
    """Return the costs (N,) of flights from deviations z (N, n), including the final state's cost.

    The cost is inf for flights that leave the limits or do not end at the trim.

    one_step: compiled result of `step_function`
    settings: third argument of `one_step`, (N, 1 + m)
    pulses: (pulses, N, m), added to the inputs one after the other
    most: largest number of steps of a flight
    """
    lowest, highest = problem.state_limits
    costs = np.full(len(z), np.inf)
    paid = np.zeros(len(z))
    flying = np.arange(len(z))
    none = np.zeros(pulses.shape[1:])
    lasting = max(min(_PULSE, most // (2 * len(pulses))), 1)
    for number in range(most):
        pulse = pulses[number // lasting] if number < len(pulses) * lasting else none
        z, price = one_step(z, pulse[flying], settings[flying])
        paid += price[:, 0]
        inside = np.all((lowest <= z) & (z <= highest), axis=1)
        if number % _LOOKED_AT == 0 or number == most - 1:
            end = quadratic_forms(z, problem.P)
            ended = inside & (end <= _CONVERGED * paid)
            costs[flying[ended]] = (paid + end)[ended]
            inside &= ~ended
        if not inside.all():
            z, paid, flying = z[inside], paid[inside], flying[inside]
        if not len(flying):
            break
    return costs


def step_function(problem: FlightProblem, bound: CostStatement, step: float) -> ca.Function:
    """Return the function (z, pulse, settings) -> (z after a step, cost of the step).

    The step is a fourth-order Runge-Kutta step with constant, saturated inputs. The cost is
    integrated by the same method.

    - settings[0] is 0 for the linear gain. It is 1 for the inputs that minimize the running cost
      plus the rate of the bound, linearized in the inputs.
    - settings[1:] are factors on the rows of the gain.
    """
    n, m = len(problem.states), len(problem.inputs)
    z, pulse, settings = ca.SX.sym("z", n), ca.SX.sym("pulse", m), ca.SX.sym("settings", 1 + m)
    of_states, of_inputs = (ca.DM(size) for size in problem.sizes)

    def rates(z: ca.SX, v: ca.SX) -> ca.SX:
        return problem.rates(ca.vertcat(z / of_states, v / of_inputs)) * of_states

    v = ca.SX.sym("v", m)
    effect = ca.substitute(ca.jacobian(rates(z, v), v), v, ca.DM.zeros(m))
    of_least_rate = -0.5 * ca.DM(np.linalg.pinv(problem.R)) @ effect.T @ gradient(bound, z)
    of_gain = -settings[1:] * (ca.DM(problem.K) @ z)
    chosen = ca.if_else(settings[0], of_least_rate, of_gain) + pulse
    lowest, highest = (ca.DM(limit) for limit in problem.input_limits)
    v = saturated(chosen, lowest, highest)
    cost = Cost(problem.Q, problem.R)

    def with_cost(y: ca.SX, _: float) -> ca.SX:
        return ca.vertcat(rates(y[:n], v), cost.rate(y[:n], v))

    moved = ca.densify(rk4(with_cost, ca.vertcat(z, 0.0), step))
    return ca.Function("step", [z, pulse, settings], [moved[:n], moved[n]], {"cse": True})


def gradient(bound: CostStatement, z: ca.SX) -> ca.SX:
    """Return the gradient (n,) at z of the piece of the bound that is largest at z.

    The gradient is 0 if no piece is positive. The saturation of a piece at its level c is ignored
    in the gradient.
    """
    largest, slope = ca.SX(0), ca.SX.zeros(z.shape)
    for piece in bound.pieces:
        M = ca.DM(piece.M)
        W, slopes = piece.W.expressions(M @ z)
        is_largest = ca.fmin(W, piece.c) > largest
        largest = ca.if_else(is_largest, ca.fmin(W, piece.c), largest)
        slope = ca.if_else(is_largest, M.T @ slopes, slope)
    return slope
