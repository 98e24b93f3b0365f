"""Enclosures of the value and the policies of games, proved with as many bits as are needed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
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
    part,
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
    FailedError,
    Proposal,
    corrected,
    first_units,
    in_doubles,
    loop_units,
    lyapunov_in_bits,
    of_control_loop,
    proposal_in_bits,
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
#: Relative radius of an enclosure whose midpoints are right to the last digit of doubles.
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
        return self.proved.exactly.game

    @cached_property
    def P(self) -> arb_mat:
        """P of the value z'P z, (n, n)."""
        states = self.proved.equation.units.states
        with precision(self.bits):
            return scaled_balls(
                Balls.around(self.proved.X, self.proved.spread).matrix, -states, -states
            )

    @cached_property
    def K(self) -> arb_mat:
        """K of the policy u = -K z, (m, n)."""
        units, gains = self.proved.equation.units, self.proved.gains
        with precision(self.bits):
            return scaled_balls(
                part(gains, slice(len(units.inputs)), slice(None)), units.inputs, -units.states
            )

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
            P = Balls.around(self.proved.X, self.proved.spread)
            price = equation.disturbance_price(P)
            assert price is not None
            ahead = P @ equation.control_loop(P, Balls(self.proved.gains))
            L = price.matrix.solve((equation.E.T @ ahead).matrix)
            return scaled_balls(L, units.disturbances, -units.states)


class UndecidedError(NoSolutionError):
    """Raised if neither a value nor that there is none is proved with 1024 bits."""


def enclosed(game: Game, delta: float | None = None) -> Enclosure:
    """Return the proved enclosure of the value and the policies of a game.

    delta: in place of that of the game

    Raises NoSolutionError with a proved reason if the game has no value, and UndecidedError if
    neither is proved.
    """
    outcome = decided(game, game.delta if delta is None else delta)
    if isinstance(outcome, str):
        raise NoSolutionError(outcome)
    return outcome


def decided(game: Game, delta: float, *, digits: bool = True) -> Enclosure | str:
    """Return the enclosure of the solution of a game, or the reason, proved, why it has no value.

    Weights that are positive semidefinite only up to rounding have a value if P > 0, or else if
    the weights raised by `RAISED` have one.

    digits: whether P and K must be right to the last digit of doubles

    Raises UndecidedError.
    """
    if has_exact_weights(game):
        return _decided(game, delta, digits=digits)
    with suppress(FailedError, NotProvedError), precision(BITS), np.errstate(all="ignore"):
        proposal = in_doubles(game, delta)
        ball = stabilizing(proposal.equation, proposal.X, proposal.Y, DoubleBalls)
        prove_value(ball)
        if ball.P.is_positive_definite() and not (digits and uncertain(ball, zeros=False)):
            return Enclosure(ball, BITS, lyapunov=proposal.lyapunov)
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
    """Return what a proposal of LAPACK proves of an equation with semidefinite weights, or "".

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
            return outcome or _outcome(corrected(proposal), Balls, digits=False, in_bits=False)
        except FailedError:
            return ""


def _have_same_gains(first: Enclosure, second: Enclosure) -> bool:
    """Return whether the gains of two enclosures move the plant alike, within 1 %.

    A sets the rounding floor (`relative_change`).
    """
    A, B = first.game.A, first.game.B
    units = np.exp2(first.proved.equation.units.states.astype(float))
    BK_first, BK_second, A_scaled = (
        matrix / units[:, None] * units
        for matrix in (B @ midpoints(first.K), B @ midpoints(second.K), A)
    )
    return relative_change(BK_second - BK_first, BK_first, A_scaled) <= GAIN_CHANGE


def relative_change(change: np.ndarray, pushed: np.ndarray, plant: np.ndarray) -> float:
    """Return |change of B K| / |B K|, inf if it is not known.

    It is at most `GAIN_CHANGE` where the change is smaller than the last digits of A.

    change, pushed, plant: change of B K, B K and A, (n, n), in units in which P is nearly 1
    """
    moved, size, rounding = (float(np.linalg.norm(each)) for each in (change, pushed, plant))
    if moved == 0.0:
        return 0.0
    size = max(size, np.finfo(float).eps * rounding / GAIN_CHANGE)
    return moved / size if math.isfinite(moved) and size > 0.0 else math.inf


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
    """Yield what proposals prove with more and more bits, and what rationals decide, or ""."""

    def in_lapack() -> Proposal:
        return in_doubles(game, delta)

    def refined() -> Proposal:
        return corrected(in_lapack())

    def with_bits() -> Proposal:
        return proposal_in_bits(game, delta)

    def proved(n_bits: int, propose: Callable[[], Proposal], arithmetic: Any) -> Enclosure | str:
        in_bits = propose is with_bits
        with precision(n_bits), np.errstate(all="ignore"):  # what is not finite proves nothing
            try:
                proposal = propose()
            except FailedError:
                equation = equation_of(game, first_units(game, delta), Balls, delta)
                return why_no_value(equation, None, in_bits=in_bits)
            return _outcome(proposal, arithmetic, digits=digits, in_bits=in_bits)

    yield proved(BITS, in_lapack, DoubleBalls)
    yield proved(BITS, refined, Balls)
    yield proved(2 * BITS, refined, Balls)
    yield why_never(game)
    for n_bits in ATTEMPTS:
        yield proved(n_bits, with_bits, Balls)
        if n_bits == 2 * BITS and len(game.A) <= MOST_STATES:
            yield why_never_at(game, delta)


def enclosed_in_bits(game: Game, n_bits: int) -> Enclosure:
    """Return the proved enclosure of a game with a number of bits.

    Raises FailedError or NotProvedError.
    """
    with precision(n_bits):
        try:
            proposal = corrected(in_doubles(game, game.delta))
            return Enclosure(_value(proposal, Balls), n_bits)
        except (FailedError, NotProvedError):
            return Enclosure(_value(proposal_in_bits(game, game.delta), Balls), n_bits)


def _value(proposal: Proposal, arithmetic: type[Bound]) -> Stabilizing[Bound]:
    """Return the ball of the stabilizing solution, which is proved to be the value.

    Raises FailedError or NotProvedError.
    """
    ball = stabilizing(proposal.equation, proposal.X, proposal.Y, arithmetic)
    try:
        prove_value(ball)
    except NotProvedError:
        prove_value(ball, of_control_loop(ball))
    return ball


def _outcome(
    proposal: Proposal, arithmetic: type[Bound], *, digits: bool, in_bits: bool
) -> Enclosure | str:
    """Return what a proposal proves: an enclosure, a reason why there is no value, or ""."""
    ball = None
    try:
        ball = stabilizing(proposal.equation, proposal.X, proposal.Y, arithmetic)
        try:
            prove_value(ball)
        except NotProvedError:
            if reason := why_no_value(ball.equation, ball, in_bits=in_bits):
                return reason
            prove_value(ball, of_control_loop(ball))
    except (FailedError, NotProvedError):
        equation = proposal.equation.with_arithmetic(Balls)
        return why_no_value(equation, ball, in_bits=in_bits)
    if digits and uncertain(ball, zeros=bits() > BITS):
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
    weighed = diagonal != 0.0
    if (diagonal < 0.0).any() or matrix[~weighed].any() or matrix[:, ~weighed].any():
        return is_semidefinite(matrix)
    part_with_weight = matrix[np.ix_(weighed, weighed)]
    if np.array_equal(part_with_weight, part_with_weight.T):
        exact = DoubleBalls.of(part_with_weight)
        if exact.is_positive_definite():
            return True
    return is_semidefinite(matrix)


def raised(game: Game, share: float = RAISED) -> Game:
    """Return the game with the diagonals of Q and R raised by a share of them."""
    Q, R = ((each + each.T) / 2.0 + share * np.diag(np.diag(each)) for each in (game.Q, game.R))
    return replace(game, Q=Q, R=R)


def uncertain(ball: Stabilizing[Bound], *, zeros: bool) -> bool:
    """Return whether a digit of P or K is not proved (`uncertainty`)."""
    return not uncertainty(ball, zeros=zeros) < DIGITS


@lru_cache(maxsize=2)
def uncertainty(ball: Stabilizing[Bound], *, zeros: bool) -> float:
    """Return the largest relative radius of P and K, rounded up; inf if a number is not known.

    P_ij is compared with √(P_ii P_jj), and K_ij with the largest K_ij / √P_jj of its row.

    zeros: whether entries that may be 0 count as known
    """
    inputs = slice(len(ball.exactly.units.inputs))
    gains = ball.all_gains.block(inputs, slice(None))
    K, radius = np.abs(gains.midpoint), gains.radius
    spread = np.nextafter(np.array([float(radius) for radius in ball.spread]), np.inf)
    with np.errstate(all="ignore"):
        sizes = np.sqrt(np.diag(ball.middle.midpoint))
        known = sizes > UP * spread
        if not (zeros or known.all()):
            return math.inf
        of_P = (spread[known] / sizes[known]) ** 2
        sizes, K, radius = sizes[known], K[:, known], radius[:, known]
        if zeros:
            known_rows = (UP * radius < K).any(1)
            K, radius = K[known_rows], radius[known_rows]
        largest = (K / sizes).max(1, keepdims=True, initial=0.0)
        of_K = np.where(radius > 0.0, radius / sizes / largest, 0.0)
    worst = UP * float(max(of_P.max(initial=0.0), of_K.max(initial=0.0)))
    return worst if math.isfinite(worst) else math.inf


def lyapunov_enclosure(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat | None:
    """Return balls that contain the solution D of F'D + D F + C = 0, or None if it is not proved.

    In discrete time, the equation is F'D F - D + C = 0. The number of bits is that of `precision`.
    None also means that F is not proved to be stable.

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
