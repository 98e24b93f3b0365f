"""Enclosures of the value and the policies of games, proved with as many bits as are needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.zero_sum import SEMIDEFINITE, Game
from controller.riccati.balls import (
    BITS,
    UP,
    Balls,
    DoubleBalls,
    ball_matrix,
    bits,
    midpoints,
    precision,
)
from controller.riccati.equation import Bound, Equation, equation_of, scaled_balls
from controller.riccati.lyapunov import Lyapunov
from controller.riccati.pickled_balls import make_balls_picklable
from controller.riccati.proof import (
    NotProvedError,
    Stabilizing,
    lyapunov_ball,
    prove_value,
    stabilizing,
)
from controller.riccati.proposal import (
    MANY_STATES,
    FailedError,
    Proposal,
    corrected_in_bits,
    corrected_in_doubles,
    first_units,
    loop_units,
    lyapunov_in_bits,
    lyapunov_of_control_loop,
    proposal_in_bits,
    proposal_in_doubles,
    proposal_of,
)
from controller.riccati.rationals import is_semidefinite
from controller.riccati.refusal import too_large_at, why_never, why_never_at, why_no_value
from hfa_support.errors import NoSolutionError

if TYPE_CHECKING:
    from flint import arb_mat

#: Bits of the attempts of a proof.
ATTEMPTS = (BITS, 2 * BITS, 4 * BITS, 8 * BITS)
#: Relative raise of the diagonals of weights that are semidefinite only up to rounding, twice the
#: rounding that `Game` accepts: they are then semidefinite.
RAISED = 2.0 * SEMIDEFINITE
#: Largest relative change of a gain B K that its data determine: two digits are known.
GAIN_CHANGE = 0.01
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
    is_raised: whether the weights are semidefinite only up to rounding, so that raised weights
        prove that there is a value
    lyapunov: solver of the Lyapunov equation of the loop of both players in doubles, if known
    """

    proved: Stabilizing[Any]
    bits: int
    is_raised: bool = False
    lyapunov: Lyapunov | None = None

    def __post_init__(self) -> None:
        """Let results that hold an enclosure be pickled."""
        make_balls_picklable()

    @property
    def game(self) -> Game:
        """The game, with its exact entries."""
        return self.proved.bounds.game

    @cached_property
    def P(self) -> arb_mat:
        """P of the value z'P z, (n, n)."""
        states = self.proved.bounds.units.states
        with precision(self.bits):
            return scaled_balls(self.proved.P_in_balls.matrix, -states, -states)

    @cached_property
    def K(self) -> arb_mat:
        """K of the policy u = -K z, (m, n)."""
        units = self.proved.bounds.units
        with precision(self.bits):
            return scaled_balls(self.proved.K.matrix, units.inputs, -units.states)

    @cached_property
    def L(self) -> arb_mat:
        """L of the worst disturbance d = L z, (k, n); 0 without a disturbance."""
        equation = self.proved.equation
        game, units = equation.game, equation.units
        with precision(self.bits):
            if not equation.is_disturbed:
                return ball_matrix(np.zeros(game.E.T.shape))
            if not equation.is_discrete:
                return ball_matrix(game.E).transpose() * self.P * equation.w
            # (δ² - E'P E) L = E'P (A - B K) keeps the digits of a small L.
            P = self.proved.P_in_balls
            price = equation.disturbance_price(P)
            assert price is not None
            ahead = P @ equation.control_loop(P, Balls.of(self.proved.gains))
            L = price.matrix.solve((equation.E.T @ ahead).matrix)
            return scaled_balls(L, units.disturbances, -units.states)


class UndecidedError(NoSolutionError):
    """Raised if neither a value nor that there is none is proved with 1024 bits."""


def decided(game: Game, delta: float, *, digits: bool = True) -> Enclosure | str:
    """Return the enclosure of the solution of a game, or the reason, proved, why it has no value.

    Weights that are positive semidefinite only up to rounding have a value if P > 0, or else if
    the weights raised by `RAISED` have one.

    delta: in place of that of the game
    digits: whether P and K must be right to the last digit of doubles

    Raises UndecidedError.
    """
    if has_exact_weights(game):
        return _decided(game, delta, digits=digits)
    return _with_positive_P(game, delta, digits=digits) or _raised_decided(
        game, delta, digits=digits
    )


def _with_positive_P(game: Game, delta: float, *, digits: bool) -> Enclosure | None:
    """Return the enclosure of a game by doubles alone if P > 0 is proved, whatever the weights."""
    with suppress(FailedError, NotProvedError), precision(BITS), np.errstate(all="ignore"):
        proposal = proposal_in_doubles(game, delta)
        ball = stabilizing(proposal.equation, proposal.X, proposal.Y, DoubleBalls)
        prove_value(ball)
        has_digits = not digits or relative_radius(ball, with_zeros=True) < DIGITS
        if ball.P.is_positive_definite() and has_digits:
            return Enclosure(ball, BITS, lyapunov=proposal.lyapunov)
    return None


def _raised_decided(game: Game, delta: float, *, digits: bool) -> Enclosure | str:
    """Return the enclosure of a game with raised weights, or the reason why it has no value.

    It is that of the weights as they are if it is proved, too. K must not depend on how much they
    are raised.
    """
    outcome = _decided(raised(game), delta, digits=digits)
    if isinstance(outcome, str):
        if outcome == why_never(game):
            return outcome
        return f"{outcome}, with weights raised by {RAISED:g}, since they are not semidefinite"
    with suppress(UndecidedError):
        unraised = _decided(game, delta, digits=digits)
        if isinstance(unraised, Enclosure):
            return replace(unraised, is_raised=True)
    raised_twice = _decided(raised(game, 2.0 * RAISED), delta, digits=digits)
    if isinstance(raised_twice, str) or not _have_same_gains(outcome, raised_twice):
        return (
            "[[Q, N], [N', R]] is positive semidefinite only up to rounding, and its rounding"
            " decides on K: an undamped mode has no cost; give each undamped mode weight in Q"
        )
    return replace(outcome, is_raised=True)


def decided_in_doubles(equation: Equation[DoubleBalls], frequency: float | None) -> Enclosure | str:
    """Return the enclosure, or why there is no value, that a proposal of LAPACK proves, or "".

    equation: of a game with semidefinite weights
    frequency: at which the gain from the disturbance may be too large, rad/s or rad/step
    """
    with np.errstate(all="ignore"):
        if frequency is not None:
            reason = too_large_at(equation.with_arithmetic(Balls), frequency)
            if reason:
                return reason
        try:
            proposal = proposal_of(equation)
            outcome = _outcome(proposal, DoubleBalls, digits=False, in_bits=False)
            return outcome or _outcome(
                corrected_in_bits(proposal), Balls, digits=False, in_bits=False
            )
        except FailedError:
            return ""


def _have_same_gains(first: Enclosure, second: Enclosure) -> bool:
    """Return whether B K of two enclosures differ by at most 1 % (`relative_change`).

    B K, not K, is what the loop A - B K sees, and does not depend on the units of the inputs.
    """
    A, B = first.game.A, first.game.B
    exponents = first.proved.bounds.units.states  # of the units in which P is nearly 1
    units = np.exp2(exponents.astype(float))
    BK_first, BK_second, A_scaled = (
        matrix / units[:, None] * units
        for matrix in (B @ midpoints(first.K), B @ midpoints(second.K), A)
    )
    return relative_change(BK_second - BK_first, BK_first, A_scaled) <= GAIN_CHANGE


def relative_change(BK_change: np.ndarray, BK: np.ndarray, A: np.ndarray) -> float:
    """Return |change of B K| / |B K|, inf if it is not known.

    It is at most `GAIN_CHANGE` where the change is smaller than the last digits of A.

    BK_change, BK, A: (n, n), in units in which P is nearly 1
    """
    change, size, size_of_A = (float(np.linalg.norm(matrix)) for matrix in (BK_change, BK, A))
    if change == 0.0:
        return 0.0
    size = max(size, np.finfo(float).eps * size_of_A / GAIN_CHANGE)
    return change / size if math.isfinite(change) and size > 0.0 else math.inf


def _decided(game: Game, delta: float, *, digits: bool) -> Enclosure | str:
    """Return the enclosure of a game with semidefinite weights, or why it has no value."""
    for outcome in _outcomes(game, delta, digits=digits):
        if outcome:
            return outcome
    raise UndecidedError(
        f"neither a value nor that there is none is proved with {ATTEMPTS[-1]} bits: the game is on"
        " a boundary; change delta or the weights slightly"
    )


def _outcomes(game: Game, delta: float, *, digits: bool) -> Iterator[Enclosure | str]:
    """Yield what proposals prove, with more and more bits, and what rationals decide, or ""."""
    attempt = partial(_attempt, game, delta, digits=digits)
    yield attempt(BITS, proposal_in_doubles, DoubleBalls)
    if len(game.A) >= MANY_STATES:  # `Pairs` have too few digits for entries of P near 0
        yield attempt(BITS, partial(proposal_in_doubles, residuals=Balls), DoubleBalls)
    yield attempt(BITS, corrected_in_doubles, Balls)
    yield attempt(2 * BITS, corrected_in_doubles, Balls)
    yield why_never(game)
    for n_bits in ATTEMPTS:
        yield attempt(n_bits, proposal_in_bits, Balls)
        if n_bits == 2 * BITS and len(game.A) <= MOST_STATES:
            yield why_never_at(game, delta)


def _attempt(
    game: Game,
    delta: float,
    n_bits: int,
    propose: Callable[[Game, float], Proposal],
    arithmetic: type[Bound],
    *,
    digits: bool,
) -> Enclosure | str:
    """Return what a proposal proves, or why there is no value if none can be made, or "".

    propose: function (game, delta) -> proposal, which may raise FailedError
    arithmetic: of the bounds
    """
    in_bits = propose is proposal_in_bits
    with precision(n_bits), np.errstate(all="ignore"):  # what is not finite proves nothing
        try:
            proposal = propose(game, delta)
        except FailedError:
            equation = equation_of(game, first_units(game, delta), Balls, delta)
            return why_no_value(equation, None, in_bits=in_bits)
        return _outcome(proposal, arithmetic, digits=digits, in_bits=in_bits)


def enclosed_in_bits(game: Game, n_bits: int) -> Enclosure:
    """Return the proved enclosure of a game with a number of bits.

    Raises NotProvedError.
    """
    for propose in (corrected_in_doubles, proposal_in_bits):
        outcome = _attempt(game, game.delta, n_bits, propose, Balls, digits=False)
        if isinstance(outcome, Enclosure):
            return outcome
    raise NotProvedError(f"the value with {n_bits} bits")


def _outcome(
    proposal: Proposal, arithmetic: type[Bound], *, digits: bool, in_bits: bool
) -> Enclosure | str:
    """Return what a proposal proves: an enclosure, a reason why there is no value, or "".

    digits: whether P and K must be right to the last digit of doubles
    in_bits: as for `why_no_value`
    """
    ball = None
    try:
        ball = stabilizing(proposal.equation, proposal.X, proposal.Y, arithmetic)
        try:
            prove_value(ball)
        except NotProvedError:
            if reason := why_no_value(ball.equation, ball, in_bits=in_bits):
                return reason
            prove_value(ball, lyapunov_of_control_loop(ball))
    except (FailedError, NotProvedError):
        equation = proposal.equation.with_arithmetic(Balls)
        return why_no_value(equation, ball, in_bits=in_bits)
    if digits and not relative_radius(ball, with_zeros=bits() == BITS) < DIGITS:
        return ""
    return Enclosure(ball, bits(), lyapunov=proposal.lyapunov)


def has_exact_weights(game: Game) -> bool:
    """Return whether [[Q, N], [N', R]] is positive semidefinite, exactly."""
    if game.N.any():
        return is_exactly_semidefinite(game.weights)
    return is_exactly_semidefinite(game.Q) and (
        not game.is_discrete or is_exactly_semidefinite(game.R)
    )


def is_exactly_semidefinite(matrix: np.ndarray) -> bool:
    """Return whether the symmetric part of a matrix of doubles is positive semidefinite.

    Decided by its diagonal, by balls, or in rationals if its least eigenvalue is 0.
    """
    diagonal = np.diag(matrix)
    if not matrix[~np.eye(len(matrix), dtype=bool)].any():
        return bool((diagonal >= 0.0).all())
    has_weight = diagonal != 0.0
    if (diagonal < 0.0).any() or matrix[~has_weight].any() or matrix[:, ~has_weight].any():
        return is_semidefinite(matrix)
    with_weight = matrix[np.ix_(has_weight, has_weight)]
    is_symmetric = np.array_equal(with_weight, with_weight.T)
    if is_symmetric and DoubleBalls.of(with_weight).is_positive_definite():
        return True
    return is_semidefinite(matrix)


def raised(game: Game, share: float = RAISED) -> Game:
    """Return the game with the diagonals of Q and R raised by a share of them."""
    Q, R = (
        (weights + weights.T) / 2.0 + share * np.diag(np.diag(weights))
        for weights in (game.Q, game.R)
    )
    return replace(game, Q=Q, R=R)


@lru_cache(maxsize=2)
def relative_radius(ball: Stabilizing[Bound], *, with_zeros: bool) -> float:
    """Return the largest relative radius of P and K, rounded up; inf if a number is not known.

    The radius of P_ij is relative to √(P_ii P_jj), and that of K_ij to √P_jj times the largest
    K_ik / √P_kk of its row.

    with_zeros: whether states and inputs whose numbers may all be 0 count, as not known
    """
    K, K_radius = np.abs(ball.K.midpoint), ball.K.radius
    spread = np.nextafter(np.array([float(radius) for radius in ball.spread]), np.inf)
    with np.errstate(all="ignore"):
        roots = np.sqrt(np.diag(ball.X.midpoint))
        has_value = roots > UP * spread
        if with_zeros and not has_value.all():
            return math.inf
        of_P = (spread[has_value] / roots[has_value]) ** 2
        roots, K, K_radius = roots[has_value], K[:, has_value], K_radius[:, has_value]
        if not with_zeros:
            is_moved = (UP * K_radius < K).any(1)
            K, K_radius = K[is_moved], K_radius[is_moved]
        largest = (K / roots).max(1, keepdims=True, initial=0.0)
        of_K = np.where(K_radius > 0.0, K_radius / roots / largest, 0.0)
    worst = UP * float(max(of_P.max(initial=0.0), of_K.max(initial=0.0)))
    return worst if math.isfinite(worst) else math.inf


def lyapunov_enclosure(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat | None:
    """Return balls that contain the solution D of F'D + D F + C = 0, (n, n), or None.

    In discrete time, the equation is F'D F - D + C = 0. The number of bits is that of `precision`.
    None means that they do not prove it, as where F is not stable.

    loop: F, (n, n), balls
    C: (n, n), symmetric, balls
    """
    units = loop_units(midpoints(loop))
    F, right = scaled_balls(loop, -units, units), scaled_balls(C, units, units)
    try:
        Y = lyapunov_in_bits(F, ball_matrix(np.eye(len(units))), is_discrete=is_discrete)
        D = lyapunov_in_bits(F, right, is_discrete=is_discrete)
        return scaled_balls(lyapunov_ball(F, right, D, Y, is_discrete=is_discrete), -units, -units)
    except (FailedError, NotProvedError):
        return None
