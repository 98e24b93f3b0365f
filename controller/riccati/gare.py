"""Exact solution of a zero-sum game, in continuous or in discrete time, with its certificate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.linear_game import game
from controller.game.zero_sum import Game, q_function
from controller.riccati.balls import BITS, ball_matrix, midpoints, precision
from controller.riccati.closed_loops import ClosedLoops, rounded_loop
from controller.riccati.enclosure import (
    Certificate,
    Enclosure,
    UndecidedError,
    decided,
)
from controller.riccati.l2_gain import GainBounds
from controller.riccati.lyapunov import loop_with, stabilizes
from controller.riccati.smallest_delta import DeltaMin, minimum_delta
from hfa_aircraft.signals import PlantNames
from hfa_support.arguments import ArrayLike
from hfa_support.cached import cached_property
from hfa_support.errors import BadInputError, NoSolutionError, numbers_in
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Roots, without_empty
from trim.linear.linear_model import LinearModel, is_state_space
from trim.linear.margins import (
    ClosedLoop,
    DiskMargin,
    LoopMargin,
    disk_of,
    named_margins,
    single_margin,
)

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, eq=False, repr=False)
class Solution(Result, Reported):
    """Value z'P z of a game, its policies u = -K z and d = L z, and its certificate.

    All follows from the enclosure. Poles, gains, margins and the smallest delta are computed when
    they are first used.

    game: the game
    enclosure: balls of P, K and L, proved
    certificate: what is proved, in words
    P: (n, n), of the value z'P z
    K: (m, n), of the policy u = -K z

    The eigenvalues of a game in discrete time are those of a step. With a discount, the optimal
    policy may not stabilize the plant (`is_stable`).

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0], delta=10.0)
    >>> solution = hfa.solve(game)
    >>> type(solution) is hfa.Solution, solution.K.shape
    (True, (1, 1))
    """

    schema = "hfa.game-solution/1"

    game: Game
    enclosure: Enclosure
    certificate: Certificate
    P: Matrix
    K: Matrix

    @cached_property
    def disturbance_gain(self) -> Matrix:
        """L of the worst disturbance d = L z, (k, n)."""
        return self.enclosure.rounded("L")

    @property
    def delta(self) -> float:
        """Disturbance weight δ of the game."""
        return self.game.delta

    @property
    def discount(self) -> float | None:
        """Discount α of one step, or None in continuous time."""
        return self.game.discount if self.game.is_discrete else None

    @property
    def spectral_radius(self) -> float | None:
        """Spectral radius of A - B K in discrete time, otherwise None."""
        return float(np.abs(self.poles()).max()) if self.game.is_discrete else None

    @property
    def H(self) -> Matrix | None:
        """Matrix of the Q-function over (x, u, w), or (x, u), in discrete time, otherwise None."""
        return q_function(self.game, self.P) if self.game.is_discrete else None

    @property
    def suboptimality_weight(self) -> np.ndarray:
        """Weight of u + K z in the cost above V*: R, in discrete time R + α B'P B, (m, m)."""
        return self.game.suboptimality_weight(self.P)

    @property
    def names(self) -> PlantNames:
        """Names and units of the game's states and inputs."""
        return self.game.names

    @cached_property
    def closed_loops(self) -> ClosedLoops:
        """Loops of the solution in states in which its value is nearly y'y."""
        return ClosedLoops(self.enclosure)

    @property
    def l2_gain(self) -> float:
        """L2 gain of the closed loop with u = -K z, from d to the cost, at most 1e-6 too large."""
        return self.l2_gain_bounds.high

    @cached_property
    def l2_gain_bounds(self) -> GainBounds:
        """Proved bounds of the L2 gain.

        In discrete time, signals are weighted by α^(k/2), as their squares are in the cost.
        """
        return self.closed_loops.l2_gain()

    @cached_property
    def closed_loop_eigenvalues(self) -> Roots:
        """Eigenvalues of A - B K, the loop without disturbance, (n,), 1/s."""
        return self.closed_loops.poles()

    @cached_property
    def worst_case_eigenvalues(self) -> Roots:
        """Eigenvalues of A - B K + E L, the loop under the worst disturbance, (n,), 1/s."""
        return self.closed_loops.worst_poles()

    def poles(self) -> np.ndarray:
        """Return the eigenvalues of A - B K, (n,) complex, 1/s."""
        return self.closed_loop_eigenvalues

    @cached_property
    def is_stable(self) -> bool:
        """True if A - B K is proved stable.

        It may be False with a discount, or if K, as rounded to doubles, destabilizes a slow mode.
        """
        return stabilizes(self.game, self.K)

    @cached_property
    def delta_min_bounds(self) -> DeltaMin:
        """Proved bounds of the smallest delta that has a solution."""
        return minimum_delta(self.game)

    @property
    def delta_min(self) -> float:
        """Smallest delta proved to have a solution, at most 1e-6 above the exact one."""
        return self.delta_min_bounds.value

    @property
    def delta_margin(self) -> float:
        """Ratio delta / delta_min, or inf if delta_min is 0."""
        return self.delta_min_bounds.margin(self.delta)

    @cached_property
    def _loop_at_inputs(self) -> ClosedLoop | None:
        """M = S - I/2 at all inputs of the closed loop, None if it is not stable in doubles."""
        return self.closed_loops.at_inputs(self.enclosure.K) if self.is_stable else None

    @cached_property
    def loops(self) -> tuple[LoopMargin, ...]:
        """Margins at each input, with the loops of the other inputs closed, computed in doubles.

        () if A - B K is not stable in doubles.
        """
        loop = self._loop_at_inputs
        return tuple(single_margin(loop, i) for i in range(len(self.K))) if loop else ()

    @property
    def loop_margins(self) -> dict[str, dict[str, float]] | None:
        """Stability margins, input -> name of the margin -> value (`named_margins`), or None."""
        return named_margins(self.names.inputs, self.loops) if self.loops else None

    @cached_property
    def disk_margin(self) -> DiskMargin | None:
        """Disk margin for all inputs together, or None if A - B K is not stable in doubles."""
        loop = self._loop_at_inputs
        return None if loop is None else disk_of(loop)

    def cost(self, z: ArrayLike) -> float:
        """Return z'P z, the value of the game from the initial state z, (n,).

        Raises BadInputError if z does not have shape (n,).
        """
        state = numbers_in("z", z)
        if state.shape != (len(self.P),):
            raise BadInputError(
                f"z has shape {state.shape}; give an array of shape ({len(self.P)},)"
            )
        return float(state @ self.P @ state)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "P": self.P,
            "K": self.K,
            "disturbance_gain": self.disturbance_gain,
            "states": self.game.names.states,
            "inputs": self.game.names.inputs,
            "state_units": self.game.names.state_units,
            "input_units": self.game.names.input_units,
            "certificate": self.certificate,
            "closed_loop_eigenvalues": self.closed_loop_eigenvalues,
            "worst_case_eigenvalues": self.worst_case_eigenvalues,
            "delta": self.delta,
            "delta_min": self.delta_min,
            "delta_margin": self.delta_margin,
        } | without_empty(
            dt=self.game.dt if isinstance(self.game.dt, float) else None,
            discount=self.discount,
            spectral_radius=self.spectral_radius,
            H=self.H,
            loop_margins=self.loop_margins,
            disk_margin=self.disk_margin,
        )

    def report(self) -> Report:
        """Return a report of the solution (`controller.solution_report`)."""
        import controller

        return controller.solution_report(self)


def solve(game: Game) -> Solution:
    """Return the exact solution of a game, proved (paper Section 3.1).

    A'P + P A + Q - P S P = 0,  K = R⁻¹B'P,  L = δ⁻²E'P,  S = B R⁻¹ B' - δ⁻²E E'

    In discrete time, with G = [√α B  √α E/δ] and W = blkdiag(R, -I):

    P = Q + α A'P A - √α A'P G (W + G'P G)⁻¹ √α G'P A,  [K; -δL] = (W + G'P G)⁻¹ √α G'P A

    With cross weights N, A is replaced by A - B R⁻¹N', Q by Q - N R⁻¹N', and R⁻¹N' is added to K.

    The entries of the game are exact numbers. P, K and L are enclosed in ball arithmetic, with as
    many bits as prove each of their digits, and with proofs that both loops are stable and that P
    is the value. The result does not depend on the user's units.

    game: the game

    Raises NoSolutionError if the game has no value, with the reason that is proved and delta_min;
    ModeError, if no delta has a value because of one mode; UndecidedError, if the game is exactly
    on a boundary.
    Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> solution = hfa.solve(game)
    >>> solution.K.round(4).tolist(), round(solution.delta_min, 4)
    ([[3.0972]], 1.0)
    """
    error = NoSolutionError
    try:
        enclosure = decided(game, game.delta)
    except UndecidedError as undecided:
        error, enclosure = UndecidedError, str(undecided)
    if isinstance(enclosure, str):
        if math.isfinite(game.delta):
            says = "no value of the game: " * (error is NoSolutionError)
            enclosure = f"{says}{enclosure}; {minimum_delta(game).advice(game.delta)}"
        raise error(enclosure)
    P, K = enclosure.rounded("P"), enclosure.rounded("K")
    if not (np.isfinite(P).all() and np.isfinite(K).all()):
        raise NoSolutionError("P or K is beyond the range of doubles; choose other units")
    return Solution(game, enclosure, Certificate(enclosure), P, K)


def lqr(
    A: ArrayLike | LinearModel | control.StateSpace,
    B: ArrayLike | None = None,
    Q: ArrayLike | None = None,
    R: ArrayLike | None = None,
    N: ArrayLike | None = None,
) -> Solution:
    """Return the linear-quadratic regulator u = -K z of z' = A z + B u.

    The regulator minimizes ∫ z'Qz + 2z'Nu + u'Ru. It is the solution of the game without
    disturbance. As in python-control, write lqr(A, B, Q, R) or lqr(linear, Q, R).

    A: (n, n); or a linear model, in place of A and B
    B: (n, m)
    Q: (n, n), symmetric positive semidefinite; or its diagonal, (n,)
    R: (m, m), symmetric positive definite; or its diagonal, (m,)
    N: (n, m), cross weights; by default 0

    Raises BadInputError if a matrix is missing or does not fit, and NoSolutionError if there is no
    certified solution.

    >>> import hfa
    >>> hfa.lqr([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [1.0, 0.0], [1.0]).K.round(4).tolist()
    [[1.0, 1.4142]]
    """
    if isinstance(A, LinearModel) or is_state_space(A):
        # lqr(linear, Q, R, N): the weights are in the places of B, Q and R, or are named.
        of_linear = [weight for weight in (B, Q, R) if weight is not None]
        if len(of_linear) not in (2, 3):
            raise BadInputError("lqr: Q or R is missing; write lqr(linear, Q, R)")
        Q, R, *crossed = of_linear
        return solve(game(A, Q=Q, R=R, delta=math.inf, N=crossed[0] if crossed else N))
    if B is None or Q is None or R is None:
        raise BadInputError("lqr: a matrix is missing; write lqr(A, B, Q, R) or lqr(linear, Q, R)")
    return solve(Game(A=A, B=B, Q=Q, R=R, N=N))


def margins(linear: LinearModel | Game, K: ArrayLike) -> dict[str, LoopMargin]:
    """Return the stability margins of u = -K x at each input, with the other loops closed.

    linear: the linear model or the game, with A and B
    K: (m, n)

    Returns input -> `LoopMargin`.

    Raises BadInputError if K is not m x n, and NoSolutionError if A - B K is not Hurwitz.

    >>> import hfa
    >>> linear = hfa.LinearModel.of([[0.0]], [[1.0]])
    >>> round(hfa.margins(linear, [[2.0]])["u1"].phase, 4)
    90.0
    """
    if isinstance(linear, Game):
        plant, inputs = linear, linear.names.inputs
    else:
        n, m = linear.B.shape
        plant, inputs = Game(linear.A, linear.B, Q=np.eye(n), R=np.eye(m)), linear.inputs
    K = plant.checked_gain(K)
    if not stabilizes(plant, K):
        raise NoSolutionError("A - B K is not stable: no margins; give a stabilizing gain")
    with precision(BITS):
        closed = midpoints(loop_with(plant, ball_matrix(K)))
    loop = rounded_loop(closed, plant.B, K, plant)
    if loop is None:
        raise NoSolutionError("a mode is undamped up to rounding: no margins; change K")
    return {name: single_margin(loop, i) for i, name in enumerate(inputs)}
