"""Simulated flights whose costs are upper bounds of the least cost.

No proof depends on the flights.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from hfa_aircraft.march.cost import Cost
from hfa_aircraft.march.ending import OF_LEAST_COST, EndRule, has_decayed
from hfa_aircraft.march.march import Rows, march
from hfa_prove.check.cost import solved_for
from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.search.clock import Clock
from hfa_prove.statements.plant import Plant
from hfa_support.native.bound import RowFunction

#: Newton steps for the inputs at a sample.
_NEWTON = 8
#: Newton steps for the inputs in a step of a flight.
_NEWTON_IN_FLIGHT = 1
#: Steps of a flight in the time constant of its fastest mode.
_PER_FASTEST = 4.0
#: Duration of a flight, in time constants of its slowest mode.
_OF_SLOWEST = 7.0
#: Largest number of steps of a flight.
_MOST_STEPS = 4000


class Inputs:
    """Inputs that minimize p · f(z, v) + v'R v within their limits, for a gradient p of a cost.

    plant: the aircraft with its input limits
    equilibrium: enclosure of the equilibrium states and inputs
    R: weight of the inputs, (m, m)
    """

    def __init__(self, plant: Plant, equilibrium: Equilibrium, R: np.ndarray) -> None:
        n = len(plant.states)
        m = len(R)
        self.m = m
        self.n = n
        x = equilibrium.x
        self._low, self._high = (plant.ends(tuple(plant.inputs)) - x[n:, None]).T
        z, v, p = ca.SX.sym("z", n), ca.SX.sym("v", m), ca.SX.sym("p", n)
        f, _ = plant.rates_at(ca.DM(x[:n]) + z, ca.DM(x[n:]) + v)
        price = ca.dot(p, f) + ca.dot(ca.DM(R) @ v, v)
        slope = ca.gradient(price, v)
        second = ca.vec(ca.jacobian(slope, v))
        self._f = ca.Function("f", [z, v], [ca.densify(f)])
        self._rates = RowFunction(self._f)
        slopes = [ca.densify(slope), ca.densify(second)]
        self._slopes = RowFunction(ca.Function("h", [z, v, p], slopes))

    def rates(self, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return z' (N, n) at state deviations z (N, n) with input deviations v (N, m)."""
        return self._rates(z, v)[0]

    def linear(self) -> np.ndarray:
        """Jacobian of the rates at the equilibrium, (n, n + m)."""
        both = ca.SX.sym("both", self.n + self.m)
        f = self._f(both[: self.n], both[self.n :])
        J = ca.Function("J", [both], [ca.densify(ca.jacobian(f, both))])
        return np.array(J(np.zeros(self.n + self.m)))

    def best(
        self, z: np.ndarray, p: np.ndarray, guess: np.ndarray | None = None, steps: int = _NEWTON
    ) -> np.ndarray:
        """Return the input deviations (N, m) that minimize p · f(z, v) + v'R v within the limits.

        z: state deviations, (N, n)
        p: gradients of the cost, (N, n)
        guess: initial inputs of Newton's method, (N, m), or None for 0
        steps: largest number of Newton steps
        """
        v = np.zeros((len(z), self.m)) if guess is None else guess
        if not self.m:
            return v
        for _ in range(steps):
            b, H = self._slopes(z, v, p)
            held_low = (v <= self._low) & (b > 0.0)
            held_high = (v >= self._high) & (b < 0.0)
            free = ~(held_low | held_high)
            right = np.where(free, -b, 0.0)[..., None]
            step = solved_for(H.reshape(-1, self.m, self.m), right, free)[..., 0]
            new = np.clip(v + step, self._low, self._high)
            change = np.abs(new - v).max()
            v = new
            if change <= 1e-9:
                break
        return v


def flight_costs(
    inputs: Inputs,
    weights: tuple[np.ndarray, np.ndarray, np.ndarray],
    gradient: Callable[[np.ndarray], np.ndarray],
    in_envelope: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    clock: Clock,
) -> np.ndarray:
    """Return the costs (N,) of flights from state deviations z (N, n).

    At the end of the simulation, z'P z is added for the remaining flight. The cost is inf for a
    flight that leaves the envelope, or whose final z'P z exceeds `OF_LEAST_COST` times its initial
    value.

    inputs: minimizing inputs for a cost gradient
    weights: weights Q and R, and the matrix P of the optimal linear quadratic cost
    gradient: z (N, n) -> gradients (N, n) of the cost that the inputs minimize
    in_envelope: z (N, n) -> mask (N,) of the points within the state limits

    Raises OutOfTimeError at the time limit of the clock.
    """
    Q, R, P = weights
    running = Cost(Q, R)
    n = len(Q)
    J = inputs.linear()
    K = np.linalg.pinv(R) @ J[:, n:].T @ P
    poles = np.linalg.eigvals(J[:, :n] - J[:, n:] @ K)
    step = 1.0 / (_PER_FASTEST * np.abs(poles).max())
    count = int(min(_MOST_STEPS, _OF_SLOWEST / (step * np.abs(poles.real).min())))
    v = inputs.best(z, gradient(z))

    def policy(y: np.ndarray, flying: np.ndarray) -> np.ndarray:
        clock(0.0, 1.0, "flights of the saturated LQR")
        z = y[:, :n]
        v[flying] = inputs.best(z, gradient(z), v[flying], _NEWTON_IN_FLIGHT)
        return v[flying]

    def rates(y: np.ndarray, v: np.ndarray) -> np.ndarray:
        z = y[:, :n]
        return np.column_stack([inputs.rates(z, v), running.rate(z, v)])

    rule = EndRule(np.finfo(float).max, lambda y: in_envelope(y[:, :n]))
    loop = Rows(rates, np.column_stack([z, np.zeros(len(z))]), step, policy)
    with np.errstate(all="ignore"):
        flown, _ = march(loop, count, over=rule.over, keep=False)
    final = flown.states[:, 0]
    first, left = (np.einsum("ki,ij,kj->k", each, P, each) for each in (z, final[:, :n]))
    converges = ~rule.is_over(final) & has_decayed(left, first, OF_LEAST_COST)
    return np.where(converges, final[:, n] + left, np.inf)
