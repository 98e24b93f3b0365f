"""Loops of a critic in continuous and in discrete time."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, symbols_for
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.cost import loss_matrix
from hfa_support.native.bound import BoundFunction
from verification.critic_errors import Exact

if TYPE_CHECKING:
    from controller.discrete.solution import DiscreteSolution
    from controller.riccati.gare import Solution

#: A simulation ends when the exact loop has decayed to exp(-`DECAY`).
DECAY = 5.0
#: It ends later for a slower linear loop, but not later than this many times the time of the exact
#: loop.
_SLOWEST = 100.0
#: Largest number of LSODA steps in a simulation of the linear plant, in one that is slow to
#: evaluate (a wide network, the nonlinear plant), and of steps of a discrete loop.
STEPS = 20_000
_FEW_STEPS = 1000
_MOST_STEPS = 20_000
#: The loop has converged if V* has decreased to this fraction.
RETURNED = 0.05
#: A loop diverges if V* exceeds this multiple of a bound on V* in the box. Its simulation ends
#: there.
_FAR = 1e12
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


class TimeAxis(Protocol):
    """Plant of a critic in continuous or discrete time."""

    #: Unit of the time of a cost, for reports.
    period: str

    @property
    def price(self) -> np.ndarray:
        """Weight of u - u* in the cost above V*, (m, m)."""

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


class InTime:
    """Plant z' = A z + B u + E d in continuous time.

    A policy u has the cost J = V* + ∫ (u - u*)'R (u - u*) - δ² (d - d*)'(d - d*) dt. The worst
    disturbance of u = -K z is d = d* + δ⁻² E'X z.

    exact: exact solution of the game, with V*, u* and d*
    """

    period = "second"

    def __init__(self, game: Game, exact: Solution) -> None:
        self._game = game
        self._exact = exact
        self.price = game.R

    def is_stable(self, K: np.ndarray) -> bool:
        """Return whether A - B K is Hurwitz."""
        return bool(spectrum(self._game.A - self._game.B @ K).abscissa < 0.0)

    def cost(self, z: np.ndarray, u: np.ndarray) -> float:
        """Return z'Q z + 2 z'N u + u'R u."""
        both = np.hstack([z, u])
        return float(both @ self._game.weights @ both)

    def excess(self, K: np.ndarray) -> np.ndarray | None:
        """Return the `loss_matrix` X of u = -K z, or None if the cost has no bound."""
        return loss_matrix(self._game, self._exact, K)

    def duration(self, *loops: np.ndarray) -> float:
        """Return the duration of a simulation, s, in which the exact loop and linear loops decay.

        loops: stable matrices, (n, n)
        """
        by_exact = abs(spectrum(self._game.A - self._game.B @ self._exact.K).abscissa)
        slowest = min([by_exact, *(abs(spectrum(loop).abscissa) for loop in loops)])
        return DECAY / max(slowest, by_exact / _SLOWEST)

    def loop(self, critic: Critic, b: np.ndarray) -> Loop:
        """Return the closed loop without disturbance.

        b: half-widths of the box of states, (n,)
        """
        z = critic.symbols
        rates = ca.DM(self._game.A) @ z + ca.DM(self._game.B) @ critic.policy(z)
        duration = self.duration(self._game.A - self._game.B @ critic.K)
        return _FlowLoop(z, rates, self._exact, duration, b)

    def worst_loop(self, critic: Critic, b: np.ndarray, X: np.ndarray) -> Loop:
        """Return the closed loop under d = d* + δ⁻² E'X z.

        The running cost is v'R v - δ² w'w, with v = u - u* and w = d - d* minus their values at the
        equilibrium.
        """
        game = self._game
        z = critic.symbols
        more = game.disturbance_gain(X)
        plant = game.A + game.E @ (self._exact.disturbance_gain + more)
        rates = ca.DM(plant) @ z + ca.DM(game.B) @ critic.policy(z)
        duration = self.duration(game.A - game.B @ critic.K, plant - game.B @ critic.K)
        loop = _FlowLoop(z, rates, self._exact, duration, b)
        if loop.equilibrium is None:
            return loop
        paid = _cost_of(critic.policy, self._exact.K, self.price, loop.equilibrium)
        if not math.isfinite(game.delta):
            return loop.with_cost(paid)
        gained = ca.DM(game.delta * more)
        rest = ca.DM(loop.equilibrium)
        return loop.with_cost(lambda z: paid(z) - ca.sumsqr(gained @ (z - rest)))


class InSteps:
    """Plant x⁺ = A x + B u + E w in discrete time, with discount factor α.

    Under the worst disturbance, a policy u has the cost
    J = V* + Σ αᵏ (u - u*)'(R + α B'P*B)(u - u*).

    exact: exact solution of the game, with V*, u* and P*
    """

    period = "step"

    def __init__(self, exact: DiscreteSolution) -> None:
        step = exact.game
        self._exact = exact
        self._worst = step.A + step.E @ exact.disturbance_gain
        self.price = step.R + exact.discount * step.B.T @ exact.P @ step.B

    def is_stable(self, K: np.ndarray) -> bool:
        """Return whether all eigenvalues of A - B K are inside the unit circle."""
        return _radius(self._exact.game.A - self._exact.game.B @ K) < 1.0

    def cost(self, z: np.ndarray, u: np.ndarray) -> float:
        """Return x'Q x + 2 x'N u + u'R u."""
        both = np.hstack([z, u])
        return float(both @ self._exact.game.weights @ both)

    def excess(self, K: np.ndarray) -> np.ndarray | None:
        """Return X = α F'X F + (K - K*)'(R + α B'P*B)(K - K*) with F = A + E L* - B K.

        The result is None if √α F is not finite or has an eigenvalue outside the open unit disk.
        """
        from scipy.linalg import solve_discrete_lyapunov

        moved = math.sqrt(self._exact.discount) * (self._worst - self._exact.game.B @ K)
        if not np.isfinite(moved).all() or _radius(moved) >= 1.0:
            return None
        change = K - self._exact.K
        return np.asarray(solve_discrete_lyapunov(moved.T, change.T @ self.price @ change))

    def loop(self, critic: Critic, b: np.ndarray) -> Loop:
        """Return the closed loop without disturbance.

        b: half-widths of the box of states, (n,)
        """
        return self._loop_of(self._exact.game.A, critic, b, 0.0 * self.price)

    def worst_loop(self, critic: Critic, b: np.ndarray, X: np.ndarray) -> Loop:
        """Return the closed loop under the worst disturbance w = L* x of the exact solution.

        The cost is Σ αᵏ v'(R + α B'P*B) v, with v = u - u* minus its value at the equilibrium.
        """
        return self._loop_of(self._worst, critic, b, self.price)

    def _loop_of(self, A: np.ndarray, critic: Critic, b: np.ndarray, price: np.ndarray) -> Loop:
        policy = critic.policy
        x = symbols_for([policy], len(b))
        B = self._exact.game.B
        after = ca.DM(A) @ x + ca.DM(B) @ policy(x)
        equilibrium = newton_equilibrium(x, after - x, b)
        paid = type(x)(0.0)
        if equilibrium is not None:
            paid = _cost_of(policy, self._exact.K, price, equilibrium)(x)
        slowest = max(self._exact.radius, _radius(A - B @ critic.K), 1e-3)
        decay = -math.log(min(slowest, 1.0 - 1e-12))
        steps = min(math.ceil(DECAY / decay), _MOST_STEPS)
        by_exact = np.linalg.matrix_power(A - B @ self._exact.K, steps)
        discount = self._exact.discount
        P = self._exact.P
        largest = _FAR * float(b @ np.abs(P) @ b)
        return _StepLoop((x, after, paid), P, (discount, steps), equilibrium, by_exact, largest)


def _radius(matrix: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def _cost_of(
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


class _FlowLoop:
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
        self._largest_value = _FAR * float(b @ np.abs(exact.P) @ b)
        self._time = time
        self.most_steps = STEPS if isinstance(rates, ca.SX) else _FEW_STEPS
        self.equilibrium = newton_equilibrium(z, rates, b)
        self._bound = self._slopes_of(0.0)

    def with_cost(self, running: Expression) -> _FlowLoop:
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
        - V* exceeds `_FAR` times its bound in the box, or the integration fails.
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


class _StepLoop:
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
