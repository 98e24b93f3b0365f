"""Cost of a linear policy above the optimum, enclosed in balls.

The excess z'D z of u = -K z over the value z'P z is no difference of two costs. With the error
Δ = K - K* of the gain, the loop F = A - B K + E L* and the slack V of the disturbance, D is the
stabilizing solution of

  F'D + D F + Δ'R Δ + D E V⁻¹ E'D = 0,  V = δ² I,

and in discrete time, with √α A, √α B and √α E in place of A, B and E, of

  F'D F - D + Δ'(R + B'P B) Δ + M'(V - E'D E)⁻¹ M = 0,  M = E'D F - E'P B Δ,  V = δ² I - E'P E.

It exists if the L2 gain of the policy is below δ. Without disturbance, the last term is 0, and the
equation is a Lyapunov equation. The policy costs up to sup z'D z / z'P z above the optimum.

Sources: Kleinman, IEEE Transactions on Automatic Control 13 (1968), 114-115; Basar and Bernhard,
H-infinity Optimal Control, Theorem 4.11.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    ROUNDOFF,
    Balls,
    ball_matrix,
    identity,
    is_positive_definite,
    midpoints,
    norm,
    precision,
    scaled_balls,
    symmetric,
    symmetric_part,
)
from controller.riccati.enclosure import Enclosure, decided, enclosed_in_bits
from controller.riccati.equation import Sensitivity
from controller.riccati.free_states import FreeStates, free_states
from controller.riccati.lyapunov import (
    FailedError,
    NotProvedError,
    change_along,
    loop_units,
    lyapunov_enclosure,
    lyapunov_in_bits,
    stability_of,
)
from controller.riccati.proof import proved_zeta
from controller.riccati.stability import discounted_loop, loop_with

if TYPE_CHECKING:
    from flint import arb_mat

#: Relative width of an enclosure that shows three digits, in all but ties.
WIDTH = 1e-6
#: A cost that is higher by less than this fraction is the same double.
SAME_DOUBLE = ROUNDOFF
#: Steps in which an upper bound is sought above the estimate, as powers of ten.
_ABOVE = range(-12, -5)
#: Largest number of Newton steps; they converge quadratically, from below.
_NEWTON_STEPS = 60
#: The number of digits doubles in each step: after one that is as small, the next is the last.
_LAST_STEP = 2.0**-40


@dataclass(frozen=True, eq=False)
class Excess:
    """Cost of u = -K z above the optimum, under the worst disturbance of the policy.

    low, high: bounds of the largest excess over all initial states, relative to the optimal cost.
        Both are inf if the cost has no bound, or is positive where the optimum is 0; high alone is
        inf if no bound is proved.
    mean: mean excess over initial states with the same optimal cost, relative to it
    worst: initial state with the excess `low`, at the edge of the box, (n,); nan without one
    matrix: D, (n, n), or None without a bounded cost
    disturbance_gain: (k, n), of the worst disturbance of the policy, minus that of the optimum
    is_stable: whether A - B K is proved stable
    is_summable: whether √α (A - B K) is, in continuous time A - B K
    from_free: cost from a state of the box where the optimum is 0, the largest of those tried; it
        counts unless the cost of the box is the same double without it
    free_state: this state, (n,), or None without such a cost
    """

    low: float
    high: float
    mean: float
    worst: np.ndarray
    matrix: np.ndarray | None
    disturbance_gain: np.ndarray
    is_stable: bool
    is_summable: bool
    from_free: float = 0.0
    free_state: np.ndarray | None = None

    @property
    def is_known(self) -> bool:
        """True if the bounds show three digits, or show that the policy is optimal."""
        if math.isinf(self.low):
            return True
        return self.is_optimal or self.high <= self.low * (1.0 + WIDTH)

    @property
    def is_optimal(self) -> bool:
        """True if no initial state has a cost that differs from the optimum as a double."""
        return self.high <= SAME_DOUBLE


def excess_of(game: Game, K: np.ndarray, box: np.ndarray) -> Excess:
    """Return the cost of u = -K z above the optimum of a game that has a value.

    K: (m, n)
    box: half-widths of the box of states, (n,)
    """
    enclosure = decided(game, game.delta, digits=False)
    assert not isinstance(enclosure, str)
    excess = without_bound(game)
    for bits in ATTEMPTS:
        with precision(bits):
            gain, is_discrete = ball_matrix(K), game.is_discrete
            if stability_of(discounted_loop(game, gain), is_discrete=is_discrete) is False:
                is_stable = stability_of(loop_with(game, gain), is_discrete=is_discrete)
                return replace(excess, is_stable=is_stable is True)
            try:
                excess = _Policy(enclosed_in_bits(enclosure, bits), K).excess(box)
            except (FailedError, NotProvedError):
                continue
        if excess.is_known and excess.matrix is not None:
            break
    return excess


def without_bound(game: Game, *, is_stable: bool = False, is_summable: bool = False) -> Excess:
    """Return the excess of a policy whose cost has no bound."""
    n, k = game.E.shape
    return Excess(
        low=math.inf,
        high=math.inf,
        mean=math.inf,
        worst=np.full(n, math.nan),
        matrix=None,
        disturbance_gain=np.zeros((k, n)),
        is_stable=is_stable,
        is_summable=is_summable,
    )


class _Solved(NamedTuple):
    """Enclosed solution of the equation of D, which exists if the excess has a bound.

    D: (n, n), balls
    gain: M, (k, n), of the worst disturbance of the policy, minus that of the optimum, balls
    """

    D: arb_mat
    gain: arb_mat


class _Policy:
    """A policy u = -K z of a game, and the matrices of its excess as balls, in the user's units.

    A, B, E: times √α, in continuous time 1
    P, K_exact, L: of the exact solution
    """

    def __init__(self, enclosure: Enclosure, K: np.ndarray) -> None:
        from flint import arb

        game = enclosure.game
        root = arb(game.discount).sqrt()
        self.game = game
        self.is_discrete = game.is_discrete
        self.A, self.B, self.E = (ball_matrix(M) * root for M in (game.A, game.B, game.E))
        self.R = symmetric_part(ball_matrix(game.R))
        self.P, self.K_exact, self.L = enclosure.P, enclosure.K, enclosure.L
        self.K = ball_matrix(K)
        self.is_disturbed = math.isfinite(game.delta) and bool(game.E.any())

    def excess(self, box: np.ndarray) -> Excess:
        """Return the excess over the box of states, known or not.

        Where P is singular, states without optimal cost are judged apart: if the policy costs
        something there, the excess has no bound. If that cost is rounding beside the costs of the
        box, the ratio is that of the policy without its error on those states.

        box: half-widths, (n,)
        """
        game = self.game
        loops = loop_with(game, self.K), self.A - self.B * self.K
        is_stable, is_summable = (
            stability_of(loop, is_discrete=game.is_discrete) is True for loop in loops
        )
        excess = without_bound(game, is_stable=is_stable, is_summable=is_summable)
        solved = self._solved(self.K) if is_summable else None
        if solved is None:
            return excess
        excess = replace(
            excess, matrix=midpoints(solved.D), disturbance_gain=midpoints(solved.gain)
        )
        free = None if is_positive_definite(self.P) else free_states(game)
        if free is None:
            return _with_ratio(excess, solved.D, self.P, [], box)
        error = free.error_of(self.K)
        if error.is_wrong:
            costs = _costs_at(solved.D, free, box)
            excess = replace(excess, from_free=costs.largest, free_state=costs.state)
            if not costs.most <= SAME_DOUBLE * float(np.diag(midpoints(self.P)) @ box**2):
                return replace(excess, worst=costs.state)
        without_error = self._solved(error.without_error)
        if without_error is None:
            return excess
        return _with_ratio(excess, without_error.D, self.P, free.pivots, box)

    def _solved(self, K: arb_mat) -> _Solved | None:
        """Return the solution of the equation of D for u = -K z, or None if it is not proved."""
        error = K - self.K_exact
        price = self.R
        loop = self.A - self.B * K
        if self.is_discrete:
            price = price + self.B.transpose() * self.P * self.B
        charge = error.transpose() * price * error
        if not self.is_disturbed:
            D = lyapunov_enclosure(loop, charge, is_discrete=self.is_discrete)
            return None if D is None else _Solved(D, 0 * self.L)
        try:
            return self._equation(loop, charge, error).solved()
        except (FailedError, NotProvedError, ZeroDivisionError):
            return None

    def _equation(self, loop: arb_mat, charge: arb_mat, error: arb_mat) -> ExcessEquation:
        """Return the equation of D of a policy that differs from the optimum by an error.

        loop: A - B K, (n, n)
        charge: Δ'R Δ, in discrete time Δ'(R + B'P B) Δ, of the error Δ = K - K*, (n, n)
        error: Δ, (m, n)
        """
        from flint import arb

        k = self.E.ncols()
        slack = identity(k) * arb(self.game.delta) ** 2
        F = loop + self.E * self.L
        if not self.is_discrete:
            return ExcessEquation(F, self.E, charge, None, slack)
        valued = self.E.transpose() * self.P
        crossed = -(valued * self.B * error)
        return ExcessEquation(F, self.E, charge, crossed, slack - valued * self.E)


@dataclass(frozen=True)
class ExcessEquation:
    """Riccati equation of the excess z'D z, under disturbances that differ by v from the optimum.

    In continuous time, F'D + D F + C + D E V⁻¹ E'D = 0. In discrete time, with the `slack` of D,

      F'D F - D + C + M'(V - E'D E) M = 0,  M = (V - E'D E)⁻¹ (E'D F + crossed).

    F, E, C: loop (n, n), (n, k) and charge of the error of the gain, (n, n)
    crossed: -E'P B Δ, (k, n), in discrete time; None in continuous time
    V: δ² I, in discrete time δ² I - E'P E, (k, k)
    """

    F: arb_mat
    E: arb_mat
    C: arb_mat
    crossed: arb_mat | None
    V: arb_mat

    @property
    def is_discrete(self) -> bool:
        """Whether the equation is that of discrete time."""
        return self.crossed is not None

    def gain(self, D: arb_mat) -> arb_mat:
        """Return M, (k, n), of the worst v = M z for D."""
        E_D = self.E.transpose() * D
        if self.crossed is None:
            return self.V.solve(E_D)
        return self.slack(D).solve(E_D * self.F + self.crossed)

    def slack(self, D: arb_mat) -> arb_mat:
        """Return V - E'D E, (k, k), in continuous time V."""
        return self.V - self.E.transpose() * D * self.E if self.is_discrete else self.V

    def sensitivity(self, slack: arb_mat, loop: Balls) -> Sensitivity:
        """Return bounds of the change of the loop F + E M where D is changed by Z.

        In continuous time, the change is E V⁻¹ E'Z. In discrete time, with the slack S of D, it is
        E (S - E'Z E)⁻¹ E'Z (F + E M), and |(S - E'Z E)⁻¹| <= 2 |S⁻¹| if |S⁻¹| |E|² |Z| <= 1/2.

        loop: F + E M at D, (n, n)
        """
        from flint import arb

        through = Balls(slack).inverse_norm() * norm(self.E) ** 2
        if not self.is_discrete:
            return Sensitivity(through, arb(0), arb(0))
        return Sensitivity(2 * through * loop.norm(), arb(0), through)

    def residual(self, D: arb_mat, gain: arb_mat) -> arb_mat:
        """Return the left side of the equation at D, (n, n).

        gain: M of D
        """
        change = change_along(Balls(self.F), Balls(D), is_discrete=self.is_discrete).matrix
        return change + self.C + gain.transpose() * self.slack(D) * gain

    def solved(self, start: arb_mat | None = None) -> _Solved:
        """Return D and its gain, enclosed in units in which the loop is balanced.

        start: (n, n), from which the search for D begins; by default 0

        Raises FailedError, NotProvedError or ZeroDivisionError.
        """
        units = loop_units(midpoints(self.F))
        zero = np.zeros(self.E.ncols(), dtype=int)
        crossed = None if self.crossed is None else scaled_balls(self.crossed, zero, units)
        scaled = ExcessEquation(
            scaled_balls(self.F, -units, units),
            scaled_balls(self.E, -units, zero),
            scaled_balls(self.C, units, units),
            crossed,
            self.V,
        )
        zeros = 0 * self.F
        D, Y = scaled.proposal(zeros if start is None else scaled_balls(start, units, units))
        D = scaled_balls(excess_ball(scaled, D, Y), -units, -units)
        return _Solved(D, self.gain(D))

    def proposal(self, D: arb_mat) -> tuple[arb_mat, arb_mat]:
        """Return D, (n, n), by Newton's method, and Y of its loop.

        From 0, D increases to the solution. Without a solution, the loop becomes unstable.

        D: where the search begins, (n, n)

        Raises FailedError.
        """
        for _ in range(_NEWTON_STEPS):
            gain = self.gain(D)
            loop = (self.F + self.E * gain).mid()
            if not _looks_stable(loop, is_discrete=self.is_discrete):
                raise FailedError("the excess has no bound")
            residual = self.residual(D, gain).mid()
            step = lyapunov_in_bits(loop, residual, is_discrete=self.is_discrete)
            D = symmetric(D + step)
            if norm(step) <= norm(D) * _LAST_STEP:
                break
        gain = self.gain(D)
        loop = (self.F + self.E * gain).mid()
        step = lyapunov_in_bits(loop, self.residual(D, gain).mid(), is_discrete=self.is_discrete)
        one = identity(self.F.nrows())
        return symmetric(D + step), lyapunov_in_bits(loop, one, is_discrete=self.is_discrete)


def excess_ball(equation: ExcessEquation, D: arb_mat, Y: arb_mat) -> arb_mat:
    """Return the ball about D that is proved to contain the stabilizing solution.

    The proof is that of `controller.riccati.proof`: with the loop F of both players at D,
    Z = D* - D solves F'Z + Z F + r + q(Z) = 0, q(Z) = Z E V⁻¹ E'Z.

    D: (n, n), proposed solution; only the midpoint of its symmetric part counts
    Y: (n, n), proposed solution of F'Y + Y F = -1, in discrete time F'Y F - Y = -1, likewise

    Raises NotProvedError if the proposal does not prove it.
    """
    D, Y = symmetric(D), symmetric(Y)
    gain = equation.gain(D)
    loop = Balls(equation.F + equation.E * gain)
    slack = equation.slack(D)
    if not is_positive_definite(slack):
        raise NotProvedError("the disturbance pays")
    zeta = proved_zeta(
        loop,
        Balls(Y),
        norm(equation.residual(D, gain)),
        equation.sensitivity(slack, loop),
        is_discrete=equation.is_discrete,
    )
    spread = [(zeta * Y[i, i]).sqrt().upper() for i in range(Y.nrows())]
    return Balls.around(D, spread).matrix


def _looks_stable(loop: arb_mat, *, is_discrete: bool) -> bool:
    """Return whether the eigenvalues of a loop in doubles may be stable.

    It ends a search that finds nothing, and decides nothing.
    """
    poles = np.linalg.eigvals(midpoints(loop))
    margin = 1.0 - np.abs(poles).max() if is_discrete else -poles.real.max()
    return bool(margin > -1e-3 * np.abs(poles).max())


class _Costs(NamedTuple):
    """Costs from states of the box without optimal cost.

    largest: cost from one of them, at the edge of the box
    state: this state, (n,)
    most: bound of the cost from every such state in the box
    """

    largest: float
    state: np.ndarray
    most: float


def _costs_at(D: arb_mat, free: FreeStates, box: np.ndarray) -> _Costs:
    """Return the costs z'D z from the directions of a basis of the states without optimal cost."""
    matrix, directions = midpoints(D), midpoints(free.basis).T
    states = [_at_edge(direction, box) for direction in directions]
    values = [float(state @ matrix @ state) for state in states]
    worst = int(np.argmax(values))
    # A state of the box is a sum of multiples of all directions, of at most box[pivot] each.
    roots = [
        box[pivot] * math.sqrt(max(float(direction @ matrix @ direction), 0.0))
        for pivot, direction in zip(free.pivots, directions, strict=True)
    ]
    return _Costs(values[worst], states[worst], sum(roots) ** 2)


class _Ratio(NamedTuple):
    """Bounds and mean of z'D z / z'P z, and a state z (n,) with the ratio `low`."""

    low: float
    high: float
    mean: float
    state: np.ndarray


def _with_ratio(
    excess: Excess, D: arb_mat, P: arb_mat, without: list[int], box: np.ndarray
) -> Excess:
    """Return an excess with the bounds and the mean of z'D z / z'P z, and its worst state.

    without: as for `_largest_ratio`
    """
    ratio = _largest_ratio(D, P, without)
    worst = _at_edge(ratio.state, box)
    return replace(excess, low=ratio.low, high=ratio.high, mean=ratio.mean, worst=worst)


def _largest_ratio(D: arb_mat, P: arb_mat, without: list[int]) -> _Ratio:
    """Return bounds of sup z'D z / z'P z.

    without: numbers of states that are left out, (d,): P and D vanish on d vectors, of which each
        has a 1 at one of them
    """
    n = P.nrows()
    kept = [state for state in range(n) if state not in without]
    if not kept:
        return _Ratio(0.0, 0.0, 0.0, np.zeros(n))
    D, P = _principal(D, kept), _principal(P, kept)
    inverse_root = _inverse_root(P)
    if inverse_root is None:
        return _Ratio(0.0, math.inf, math.nan, np.zeros(n))
    relative_D = symmetric(inverse_root.transpose() * D * inverse_root)
    ratios, vectors = np.linalg.eigh(midpoints(relative_D))
    direction = inverse_root.mid() * ball_matrix(vectors[:, -1:])
    low, high = ratio_bounds(D, P, direction, float(ratios[-1]))
    state = np.zeros(n)
    state[kept] = midpoints(direction)[:, 0]
    return _Ratio(low, high, max(float(ratios.mean()), 0.0), state)


def ratio_bounds(
    D: arb_mat, P: arb_mat, direction: arb_mat, estimate: float
) -> tuple[float, float]:
    """Return proved bounds of sup z'D z / z'P z, inf if no upper one is found near an estimate.

    A vector proves the lower bound, and r P - D > 0 the upper bound r.

    direction: the vector, (n, 1)
    estimate: of the largest ratio
    """
    from flint import arb

    low = (direction.transpose() * D * direction)[0, 0] / (
        (direction.transpose() * P * direction)[0, 0]
    )
    least = math.nextafter(float(low.lower()), 0.0) if low.is_finite() else 0.0
    at_least = arb(max(estimate, SAME_DOUBLE / 2.0))
    for exponent in _ABOVE:
        bound = (at_least * (1 + arb(10) ** exponent)).mid()
        if is_positive_definite(P * bound - D):
            return max(least, 0.0), math.nextafter(float(bound), math.inf)
    return max(least, 0.0), math.inf


def _principal(matrix: arb_mat, kept: list[int]) -> arb_mat:
    """Return the rows and columns of a matrix with these numbers."""
    return ball_matrix([[matrix[i, j] for j in kept] for i in kept])


def _inverse_root(P: arb_mat) -> arb_mat | None:
    """Return an approximate W, upper triangular, with W'P W = 1, or None unless P may be positive.

    With P = L D L', W' = D^(-1/2) L⁻¹, and None if a pivot in D is not positive.
    """
    n = P.nrows()
    rows = P.mid().tolist()
    L_inverse = identity(n).tolist()
    pivots = []
    for k in range(n):
        pivot = rows[k][k]
        if not pivot > 0:
            return None
        pivots.append(pivot)
        for i in range(k + 1, n):
            factor = (rows[i][k] / pivot).mid()
            for j in range(k + 1, i + 1):
                rows[i][j] = (rows[i][j] - factor * rows[j][k]).mid()
            for j in range(k + 1):
                L_inverse[i][j] = (L_inverse[i][j] - factor * L_inverse[k][j]).mid()
    W_transposed = [
        [entry / pivot.sqrt() for entry in row]
        for row, pivot in zip(L_inverse, pivots, strict=True)
    ]
    return ball_matrix(W_transposed).transpose().mid()


def _at_edge(direction: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return the multiple of a direction at the edge of the box.

    Its largest entry, relative to the box, is positive.
    """
    relative = direction / box
    largest = relative[np.argmax(np.abs(relative))]
    return direction / largest if largest else direction
