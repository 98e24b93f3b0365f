"""Enclosures of the value and the policies of games, proved with as many bits as are needed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    BITS,
    UP,
    Balls,
    DoubleBalls,
    Matrix,
    ball_matrix,
    bits,
    identity,
    precision,
    scaled_balls,
)
from controller.riccati.candidate import (
    MOST_STATES_IN_BITS,
    Candidate,
    candidate_in_bits,
    candidate_in_doubles,
    corrected_in_bits,
    failures,
    first_units,
    sizes_of,
)
from controller.riccati.equation import Equation, Units, equation_of
from controller.riccati.free_states import states_without_cost
from controller.riccati.lyapunov import (
    FailedError,
    NotProvedError,
    lyapunov_in_bits,
    shape_in_doubles,
)
from controller.riccati.pickled_balls import make_balls_picklable
from controller.riccati.proof import Stabilizing, prove_control_loop, prove_prices, stabilizing
from controller.riccati.refusal import (
    has_semidefinite_weights,
    why_never,
    why_never_at,
    why_no_value,
)
from hfa_support.errors import NoSolutionError

if TYPE_CHECKING:
    from flint import arb_mat

#: Largest number of states for which an eigenvalue on the boundary of stability is decided in
#: rationals, which takes a second.
MOST_STATES = 16
#: Relative radius of an enclosure whose midpoints are right to the last digit of doubles: an eighth
#: of their roundoff 2^-53.
DIGITS = 2.0**-56


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Matrices of balls, in the user's units, that contain the exact solution of a game.

    proved: ball of the stabilizing solution
    bits: of the proof
    """

    proved: Stabilizing[Any]
    bits: int

    def __post_init__(self) -> None:
        """Let results that hold an enclosure be pickled."""
        make_balls_picklable()

    @property
    def game(self) -> Game:
        """The game, with its exact entries."""
        return self.proved.bounds.game

    @property
    def units(self) -> Units:
        """Units and states of the proof."""
        return self.proved.bounds.units

    @cached_property
    def value_in_units(self) -> Balls:
        """P, (n, n), in the units of the proof."""
        with precision(self.bits):
            return Balls(self.units.value(self.proved.P_in_balls.matrix))

    @cached_property
    def gain_in_units(self) -> Balls:
        """K, (m, n), in the units of the proof."""
        with precision(self.bits):
            return Balls(self.units.gain(self.proved.K.matrix))

    @cached_property
    def P(self) -> arb_mat:
        """P of the value z'P z, (n, n)."""
        states = self.units.states
        with precision(self.bits):
            return scaled_balls(self.value_in_units.matrix, -states, -states)

    @cached_property
    def K(self) -> arb_mat:
        """K of the policy u = -K z, (m, n)."""
        with precision(self.bits):
            return scaled_balls(self.gain_in_units.matrix, self.units.inputs, -self.units.states)

    @cached_property
    def L(self) -> arb_mat:
        """L of the worst disturbance d = L z, (k, n); 0 without a disturbance."""
        equation, units = self.proved.equation, self.units
        with precision(self.bits):
            if not equation.is_disturbed:
                return ball_matrix(np.zeros(self.game.E.T.shape))
            P = self.proved.P_in_balls
            price = equation.disturbance_price(P)
            if price is None:
                L = (equation.E.T @ P).times(equation.w).matrix
            else:  # (δ² - E'P E) L = E'P (A - B K) keeps the digits of a small L.
                ahead = P @ equation.control_loop(P, self.proved.gains)
                L = price.matrix.solve((equation.E.T @ ahead).matrix)
            return scaled_balls(units.gain(L), units.disturbances, -units.states)

    def relative_radius(self, *, with_zeros: bool) -> float:
        """Return the largest relative radius of P and K, rounded up; inf if a number is not known.

        The radius of P_ij is relative to √(P_ii P_jj), and that of K_ij to √P_jj times the largest
        K_ik / √P_kk of its row, with |P| in place of an indefinite P.

        with_zeros: whether states and inputs whose numbers may all be 0 count, as not known
        """
        P, K = self.value_in_units, np.abs(self.gain_in_units.midpoint)
        P_radius, K_radius = P.radius, self.gain_in_units.radius
        with np.errstate(all="ignore"):
            sizes = sizes_of(P.midpoint)
            has_value = sizes > UP * np.diag(P_radius)
            if with_zeros and not (has_value | states_without_cost(self.game)).all():
                return math.inf
            roots = np.sqrt(sizes[has_value])
            of_P = P_radius[np.ix_(has_value, has_value)] / np.outer(roots, roots)
            K, K_radius = K[:, has_value], K_radius[:, has_value]
            if not with_zeros:
                is_moved = (UP * K_radius < K).any(1)
                K, K_radius = K[is_moved], K_radius[is_moved]
            largest = (K / roots).max(1, keepdims=True, initial=0.0)
            of_K = np.where(K_radius > 0.0, K_radius / roots / largest, 0.0)
        worst = UP * float(max(of_P.max(initial=0.0), of_K.max(initial=0.0)))
        return worst if math.isfinite(worst) else math.inf


class UndecidedError(NoSolutionError):
    """Raised if neither a value nor that there is none is proved with 1024 bits."""


def decided(game: Game, delta: float, *, digits: bool = True) -> Enclosure | str:
    """Return the enclosure of the solution of a game, or the reason, proved, why it has no value.

    What makes the stabilizing solution the value is said in `controller.riccati.proof`.

    delta: in place of that of the game
    digits: whether P and K must be right to the last digit of doubles

    Raises UndecidedError.
    """
    outcome = decided_at(game, delta, digits=digits)
    is_disturbed = math.isfinite(delta) and game.E.any()
    if isinstance(outcome, str) or not is_disturbed or has_semidefinite_weights(game):
        return outcome
    undisturbed = decided_at(game, math.inf)
    return undisturbed if isinstance(undisturbed, str) else outcome


def decided_at(
    game: Game,
    delta: float,
    *,
    digits: bool = False,
    near: Units | None = None,
    frequency: float | None = None,
) -> Enclosure | str:
    """Return the enclosure of a game that has a value without disturbance, or why it has none.

    near: units and states in which P is nearly 1, if they are known
    frequency: at which the gain from the disturbance may be too large, rad/s or rad/step

    Raises UndecidedError.
    """
    for outcome in _outcomes(game, delta, near, frequency, digits=digits):
        if outcome:
            return outcome
    why = f"neither a value nor that there is none is proved with {ATTEMPTS[-1]} bits"
    if len(game.A) > MOST_STATES_IN_BITS:
        why = (
            "neither a value nor that there is none is proved in doubles, and more digits take long"
            f" for more than {MOST_STATES_IN_BITS} states; leave out states that no input reaches"
        )
    raise UndecidedError(f"not decided: {why}; change delta or the weights slightly")


def _outcomes(
    game: Game, delta: float, near: Units | None, frequency: float | None, *, digits: bool
) -> Iterator[Enclosure | str]:
    """Yield what candidates prove, with more and more bits, and what rationals decide, or ""."""
    candidate = None
    with precision(BITS), np.errstate(all="ignore"):
        try:
            candidate = candidate_in_doubles(game, delta, near)
            yield _outcome(candidate, DoubleBalls, digits=digits, in_bits=False)
        except FailedError:
            equation = equation_of(game, near or first_units(game, delta), Balls, delta)
            yield why_no_value(equation, None, frequency, in_bits=False)
    for n_bits in ATTEMPTS[:2]:
        if candidate is not None:
            yield _corrected_outcome(candidate, n_bits, digits=digits)
    yield why_never(game)
    for n_bits in ATTEMPTS:
        with precision(n_bits), np.errstate(all="ignore"):
            try:
                in_bits = candidate_in_bits(game, delta)
            except FailedError:
                if len(game.A) > MOST_STATES_IN_BITS:
                    return
                equation = equation_of(game, first_units(game, delta), Balls, delta)
                yield why_no_value(equation, None, in_bits=True)
            else:
                yield _outcome(in_bits, Balls, digits=digits, in_bits=True)
        if n_bits == 2 * BITS and len(game.A) <= MOST_STATES:
            yield why_never_at(game, delta)


def _corrected_outcome(candidate: Candidate, n_bits: int, *, digits: bool) -> Enclosure | str:
    """Return what a candidate of LAPACK proves if it is corrected in balls, or ""."""
    with precision(n_bits), np.errstate(all="ignore"):
        try:
            corrected = corrected_in_bits(candidate)
        except FailedError:
            return ""
        return _outcome(corrected, Balls, digits=digits, in_bits=False)


@lru_cache(maxsize=8)
def enclosed_in_bits(enclosure: Enclosure, n_bits: int) -> Enclosure:
    """Return an enclosure with at least this number of bits.

    Raises NotProvedError.
    """
    if n_bits <= enclosure.bits:
        return enclosure
    found = enclosure.proved
    candidate = Candidate(found.equation, found.X, np.eye(found.bounds.n))
    outcome = _corrected_outcome(candidate, n_bits, digits=False)
    if isinstance(outcome, str):
        raise NotProvedError(f"the value with {n_bits} bits")
    return outcome


def _outcome(
    candidate: Candidate, arithmetic: type[Matrix], *, digits: bool, in_bits: bool
) -> Enclosure | str:
    """Return what a candidate proves: an enclosure, a reason why there is no value, or "".

    digits: whether P and K must be right to the last digit of doubles
    in_bits: as for `why_no_value`
    """
    ball = None
    try:
        ball = stabilizing(candidate.equation, candidate.X, candidate.Y, arithmetic)
        prove_value(ball)
    except (FailedError, NotProvedError):
        if arithmetic is DoubleBalls and ball is None:
            return ""  # determinants in balls take longer than another proof
        return why_no_value(candidate.equation, ball, in_bits=in_bits)
    enclosure = Enclosure(ball, bits())
    if digits and not enclosure.relative_radius(with_zeros=bits() == BITS) < DIGITS:
        return ""
    return enclosure


def proved_ball(candidate: Candidate, arithmetic: type[Matrix]) -> Stabilizing[Matrix]:
    """Return the ball of a value that a candidate proves, where there is one without disturbance.

    Raises FailedError or NotProvedError.
    """
    ball = stabilizing(candidate.equation, candidate.X, candidate.Y, arithmetic)
    prove_value(ball)
    return ball


def prove_value(ball: Stabilizing[Any]) -> None:
    """Prove that the players pay and that the loop without disturbance is stable.

    Raises FailedError or NotProvedError.
    """
    prove_prices(ball)
    if ball.bounds.is_disturbed:
        prove_control_loop(ball, _shape_of(ball.control_loop, ball.bounds))


def _shape_of(loop: Matrix, equation: Equation[Matrix]) -> Balls | np.ndarray:
    """Return a candidate Y of F'Y + Y F = -1 of a loop F, in discrete time of F'Y F - Y = -1.

    Raises FailedError.
    """
    if isinstance(loop, Balls):
        one = identity(equation.n)
        return Balls(lyapunov_in_bits(loop.matrix.mid(), one, is_discrete=equation.is_discrete))
    with failures():
        return shape_in_doubles(loop.midpoint, is_discrete=equation.is_discrete)
