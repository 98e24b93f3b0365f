"""What a verdict needs of a game, in continuous and in discrete time, and simulations of loops."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from hfa_support.native.bound import BoundFunction
from hfa_support.reporting.checks import Check
from verification.critic_errors import Exact
from verification.scope import NonlinearPlant
from verification.verdict import Section

#: A simulation ends when the exact loop has decayed to exp(-`DECAY`).
DECAY = 5.0
#: It ends later for a slower linear loop, but not later than this many times the time of the exact
#: loop.
SLOWEST = 100.0
#: Largest number of LSODA steps in a simulation of the linear plant, in one that is slow to
#: evaluate (a wide network, the nonlinear plant), and of steps of a discrete loop.
STEPS = 20_000
FEW_STEPS = 1000
MOST_STEPS = 20_000
#: The loop has converged if V* has decreased to this fraction.
RETURNED = 0.05
#: A loop diverges if V* exceeds this multiple of a bound on V* in the box. Its simulation ends
#: there.
FAR = 1e12
#: Largest number of Newton steps to an equilibrium, and its largest distance, in boxes.
_NEWTON_STEPS = 30
_FARTHEST_REST = 100.0
Expression = Callable[[ca.SX], ca.SX]


class Loop(Protocol):
    """Closed loop of a plant and a policy, for simulation."""

    @property
    def equilibrium(self) -> np.ndarray | None:
        """Equilibrium of the loop near z = 0, (n,), or None if none is found."""

    def simulate(self, start: np.ndarray) -> tuple[np.ndarray, float] | None:
        """Simulate the loop from the initial state `start` (n,).

        Returns the end state minus the equilibrium, (n,), and the cost, or None if the loop does
        not converge.
        """


class LinearLoop(NamedTuple):
    """Verdict on the linear loop u = -K z of a critic.

    checks: stability, and in continuous time the L2 gain.
    cost_lost: largest cost above the optimum over all initial conditions, percent, or inf.
    section: section of the report, with the cost, gain and margins.
    """

    checks: list[Check]
    cost_lost: float
    section: Section


class TimeAxis(Protocol):
    """What a verdict on a critic needs of a game: its exact solution, and everything that differs
    between continuous and discrete time.

    The pipeline (`verify`) and all searches use a game only through this protocol. A verdict on
    another kind of game is another implementation.

    period: unit of the time of a cost: second or step.
    price: weight of u - u* in the cost above V*, (m, m).
    """

    period: str
    price: np.ndarray

    @property
    def step(self) -> Game:
        """The game; in discrete time, the game of one step."""

    @property
    def exact(self) -> Exact:
        """Certified solution of the game."""

    @property
    def name(self) -> str:
        """The game in the first line of a verdict, such as "linear game"."""

    @property
    def solution(self) -> str:
        """What `exact` is, for the heading of a report."""

    # The critic and its matrices.
    def critic(self, given: Critic) -> Critic:
        """Return the critic with the policy that its value implies in this time."""

    def gain(self, P: np.ndarray) -> np.ndarray:
        """Return the gain K (m, n) of the policy that the value z'P z implies."""

    def more_errors(self, critic: Critic, box: np.ndarray, limit: float) -> list[Check]:
        """Return the checks of errors besides those of K, P, V and u.

        box: half-widths of the box of states, (n,)
        """

    def linear_loop(self, critic: Critic, is_exact: bool) -> LinearLoop:
        """Return the verdict on the loop u = -K z.

        is_exact: whether the critic equals the exact solution, for the texts
        """

    def value_checks(self, P: np.ndarray, limit: float) -> list[Check]:
        """Return the checks of the matrix P of a critic's value, besides its errors.

        limit: limit of the residual of the Riccati equation
        """

    def game_loop(self, P: np.ndarray) -> Check:
        """Return the check that the loop with both policies of the value z'P z is stable."""

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Return the relative residuals of the Riccati equation, (N,), for N matrices P."""

    # Critics that are not quadratic: the exact functions, and simulations.
    def exact_at(self, kind: str, z: ca.SX) -> ca.SX:
        """Return the exact function "value", "gradient" or "policy" at the state z, (n,)."""

    def is_stable(self, K: np.ndarray) -> bool:
        """Return whether the loop A - B K is stable."""

    def cost(self, z: np.ndarray, u: np.ndarray) -> float:
        """Return the cost of a state and an input per second, or per step."""

    def excess(self, K: np.ndarray) -> np.ndarray | None:
        """Return X (n, n) with J - V* = z'X z for the policy u = -K z under its disturbance.

        The result is None if the loop is not stable or the cost has no bound.
        """

    def loop(self, critic: Critic, b: np.ndarray) -> Loop:
        """Return the closed loop without disturbance.

        b: half-widths of the box of states, (n,)
        """

    def worst_loop(self, critic: Critic, b: np.ndarray, X: np.ndarray) -> Loop:
        """Return the closed loop under the disturbance of u = -K z, the critic's linear part.

        The cost is J - V*. Inputs and disturbances count from their values at the equilibrium.

        b: half-widths of the box of states, (n,)
        X: (n, n), `excess` of K
        """

    def plant_loop(
        self, plant: NonlinearPlant, critic: Critic | None, b: np.ndarray
    ) -> Loop | None:
        """Return the closed loop of the nonlinear plant, or None if it is not simulated.

        critic: the critic, or None for the exact policy
        b: half-widths of the box of states, (n,)
        """


def quadratic_at(exact: Exact, kind: str, z: ca.SX) -> ca.SX:
    """Return z'Pz ("value"), 2 P z ("gradient") or -K z ("policy") of an exact solution."""
    if kind == "value":
        return ca.bilin(ca.DM(exact.P), z, z)
    if kind == "gradient":
        return 2.0 * ca.DM(exact.P) @ z
    return -ca.DM(exact.K) @ z


def cost_of(
    policy: ca.Function, K: np.ndarray, price: np.ndarray, equilibrium: np.ndarray
) -> Expression:
    """Return the cost rate of a policy as the function z -> v' price v.

    v = u(z) + K z - (u(e) + K e) is the deviation from the exact policy, minus its value at the
    equilibrium e.

    K: gain of the exact policy u* = -K z
    price: weight, (m, m)
    equilibrium: equilibrium of the loop, (n,)
    """
    at_rest = np.array(policy(equilibrium)).ravel() + K @ equilibrium

    def cost(z: ca.SX) -> ca.SX:
        away = policy(z) + ca.DM(K) @ z - ca.DM(at_rest)
        return ca.bilin(ca.DM(price), away, away)

    return cost


class _DivergedError(Exception):
    """Error for a simulation that is far outside the box, or not finite."""


class FlowLoop:
    """Closed loop z' = rates(z), cost' = running(z), integrated with LSODA.

    rates and running are CasADi expressions of z (n,).

    exact: exact solution, whose P measures convergence
    time: duration of a simulation, s
    b: half-widths of the box of states, (n,)
    equilibrium: equilibrium near z = 0, or None if none is found
    """

    def __init__(self, z: ca.SX, rates: ca.SX, exact: Exact, time: float, b: np.ndarray) -> None:
        self._z = z
        self._rates = rates
        self._P = exact.P
        self._value = ca.bilin(ca.DM(exact.P), z, z)
        self._largest_value = FAR * float(b @ np.abs(exact.P) @ b)
        self._time = time
        self.most_steps = STEPS if isinstance(rates, ca.SX) else FEW_STEPS
        self.equilibrium = newton_equilibrium(z, rates, b)
        self._bound = self._slopes_of(0.0)

    def with_cost(self, running: Expression) -> FlowLoop:
        """Set the running cost and return the loop.

        running: z -> cost rate, 0 at the equilibrium
        """
        self._bound = self._slopes_of(running(self._z))
        return self

    def _slopes_of(self, running: ca.SX | float) -> BoundFunction:
        slopes = ca.densify(ca.vertcat(self._rates, running))
        return BoundFunction(ca.Function("slopes", [self._z], [slopes, self._value]))

    def _slopes(self, y: np.ndarray, _: float) -> np.ndarray:
        self._bound.inputs[0][:] = y[:-1]
        self._bound()
        slopes, value = self._bound.results
        if not value[0] <= self._largest_value:
            raise _DivergedError
        return slopes

    def simulate(self, start: np.ndarray) -> tuple[np.ndarray, float] | None:
        """Simulate the loop from the initial state `start` (n,).

        Returns the end state minus the equilibrium, and the cost. The result is None in these
        cases:
        - The loop has no equilibrium near z = 0.
        - V* about the equilibrium does not decrease to `RETURNED` times its initial value.
        - V* exceeds `FAR` times its bound in the box, or the integration fails.
        """
        from scipy.integrate import odeint

        if self.equilibrium is None:
            return None
        tolerances = {"rtol": 1e-7, "atol": 1e-9 * np.abs(start).max(), "mxstep": self.most_steps}
        with (
            np.errstate(all="ignore"),
            warnings.catch_warnings(action="ignore"),
        ):  # warnings of LSODA when it fails
            try:
                (_, end), outcome = odeint(
                    self._slopes,
                    np.append(start, 0.0),
                    [0.0, self._time],
                    full_output=True,
                    **tolerances,
                )
            except _DivergedError:
                return None
        if outcome["message"] != "Integration successful." or not np.all(np.isfinite(end)):
            return None
        z = end[:-1] - self.equilibrium
        begin = start - self.equilibrium
        if z @ self._P @ z > RETURNED * (begin @ self._P @ begin):
            return None
        return z, float(end[-1])


class StepLoop:
    """Closed loop x⁺ = after(x) with cost Σ αᵏ paid(x_k).

    expressions: symbols x (n,), after and paid
    P: matrix of V*, (n, n)
    sums: discount factor α and number of steps
    by_exact: state-transition matrix of the exact loop over all steps, (n, n)
    equilibrium: equilibrium near x = 0, or None if none is found
    largest_value: V* above which the loop diverges
    """

    def __init__(
        self,
        expressions: tuple[ca.SX, ca.SX, ca.SX],
        P: np.ndarray,
        sums: tuple[float, int],
        equilibrium: np.ndarray | None,
        by_exact: np.ndarray,
        largest_value: float,
    ) -> None:
        x, after, paid = expressions
        discount, steps = sums
        cost = type(x).sym("cost", 2)  # the sum so far, and αᵏ
        total = ca.vertcat(cost[0] + cost[1] * paid, discount * cost[1])
        before = ca.vertcat(x, cost)
        value = ca.bilin(ca.DM(P), x, x)
        step = ca.Function("step", [before], [ca.densify(ca.vertcat(after, total)), value])
        self._step = BoundFunction(step)
        self._steps = steps
        self._P = P
        self._largest_value = largest_value
        self._by_exact = by_exact
        self.equilibrium = equilibrium

    def simulate(self, start: np.ndarray) -> tuple[np.ndarray, float] | None:
        """Simulate the loop from the initial state `start` (n,).

        Returns the end state minus the equilibrium, and the cost, or None if the loop does not
        converge. The loop converges if V* about the equilibrium decreases to `RETURNED` times its
        initial value, or to twice the final V* of the exact loop.
        """
        if self.equilibrium is None:
            return None
        end = np.concatenate([start, [0.0, 1.0]])
        for _ in range(self._steps):
            self._step.inputs[0][:] = end
            self._step()
            after, value = self._step.results
            if not (np.isfinite(after).all() and value[0] <= self._largest_value):
                return None
            end = after.copy()
        x = end[:-2] - self.equilibrium
        begin = start - self.equilibrium
        by_exact = self._by_exact @ begin
        allowed = max(RETURNED * (begin @ self._P @ begin), 2.0 * (by_exact @ self._P @ by_exact))
        if x @ self._P @ x > allowed:
            return None
        return x, float(end[-2])


def newton_equilibrium(z: ca.SX, rates: ca.SX, b: np.ndarray) -> np.ndarray | None:
    """Return the equilibrium z (n,) that Newton's method finds from z = 0, or None.

    The result is None without convergence. The iterates must stay within |z_i| <= `_FARTHEST_REST`
    b_i.

    z: symbols, (n,)
    rates: expression of z', or of x⁺ - x, in these symbols, (n,)
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
        if np.any(np.abs(point) > _FARTHEST_REST * b):
            return None
        if np.all(np.abs(change) <= 1e-12 * b):
            return point
    return None
