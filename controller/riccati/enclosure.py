"""Enclosures of the value and the policies of games, proved with as many bits as are needed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import SYMMETRIC, Game, least_scaled_eigenvalue
from controller.riccati.balls import (
    ATTEMPTS,
    BITS,
    ball_matrix,
    bits,
    is_positive_definite,
    midpoints,
    part,
    precision,
    radii,
    scaled,
)
from controller.riccati.candidate import (
    MOST_STATES_IN_BITS,
    Candidate,
    candidate_in_bits,
    corrections,
    first_units,
    proposed,
    sizes_of,
)
from controller.riccati.equation import Equation, Units
from controller.riccati.lyapunov import (
    FailedError,
    NotProvedError,
    solved_in_bits,
)
from controller.riccati.rationals import zeros_of
from controller.riccati.refusal import (
    Stabilizing,
    has_semidefinite_weights,
    refuse_modes,
    stabilizing,
    why_no_value,
    why_not_the_value,
)
from hfa_support.cached import cached_property
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.results import Result

if TYPE_CHECKING:
    from flint import arb_mat


#: Relative radius of an enclosure whose midpoints are right to the last digit of doubles: an eighth
#: of their roundoff 2^-53, far below which the rounding of this radius is.
ALL_DIGITS = 2.0**-56
#: Largest size of a number that is shown as 0, relative to its row.
OF_ZEROS = 1e-24


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Matrices of balls, in the user's units, that contain the exact solution of a game.

    game: the game, with its exact entries
    units: units and states of the proof
    proved: ball of the stabilizing solution, in these units and states
    bits: number of bits of the proof
    """

    game: Game
    units: Units
    proved: Stabilizing
    bits: int

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what proves the enclosure again where a result is stored or copied."""
        return decided, (self.game, self.proved.equation.delta)

    @cached_property
    def P_in_units(self) -> arb_mat:
        """P of the states in units of powers of two, (n, n)."""
        with precision(self.bits):
            return self.units.value(self.proved.P)

    @cached_property
    def K_in_units(self) -> arb_mat:
        """K of the states and inputs in units of powers of two, (m, n)."""
        with precision(self.bits):
            return self.units.gain(part(self.proved.gains, slice(len(self.units.inputs))))

    @cached_property
    def L_in_units(self) -> arb_mat:
        """L of the states and disturbances in units of powers of two, (k, n)."""
        equation, P, gains, _ = self.proved
        with precision(self.bits):
            L = equation.E.transpose() * P
            _, of_disturbances = equation.weights(P)
            # δ² L = E'P, in discrete time (δ² - E'P E) L = E'P (A - B K): with all digits of L.
            if equation.is_discrete:
                L = L * equation.control_loop(gains)
            L = L * 0 if of_disturbances is None else of_disturbances.solve(L)
            return self.units.gain(L)

    @cached_property
    def P(self) -> arb_mat:
        """P of the value z'P z, (n, n)."""
        return self._of_user("P")

    @cached_property
    def K(self) -> arb_mat:
        """K of the policy u = -K z, (m, n)."""
        return self._of_user("K")

    @cached_property
    def L(self) -> arb_mat:
        """L of the worst disturbance d = L z, (k, n); 0 without a disturbance."""
        return self._of_user("L")

    @lru_cache(maxsize=8)  # noqa: B019 - of few enclosures at once
    def numbers(self, name: str) -> Numbers:
        """Return the numbers of "P", "K" or "L" in units of powers of two."""
        balls = getattr(self, f"{name}_in_units")
        return Numbers(midpoints(balls), radii(balls))

    def rounded(self, name: str) -> np.ndarray:
        """Return the midpoints of "P", "K" or "L", read-only, 0 where no digit is known."""
        middle, radius = self.numbers(name)
        with np.errstate(over="ignore"):
            known = np.where(np.abs(middle) <= radius, 0.0, middle)
            rounded = np.ldexp(known, np.add.outer(self._rows(name), -self.units.states))
        rounded.setflags(write=False)
        return np.asarray(rounded)

    def _rows(self, name: str) -> np.ndarray:
        """Return the exponents of the rows of "P", "K" or "L" in the user's units."""
        states, inputs, disturbances, _ = self.units
        return {"P": -states, "K": inputs, "L": disturbances}[name]

    def _of_user(self, name: str) -> arb_mat:
        """Return "P", "K" or "L" in the user's units."""
        with precision(self.bits):
            in_units = getattr(self, f"{name}_in_units")
            return scaled(in_units, self._rows(name), -self.units.states)

    @cached_property
    def digits(self) -> Digits:
        """What is known of the digits of P and K.

        Row i of P where P_ii may be 0, and K_ij where its scale may be 0, are known only if zeros
        of the game prove that they are 0 or, with many bits, if their nearest doubles are 0.
        """
        # Rows of P and entries of K that are known to be 0, or to round to it.
        zero_states, zero_gains = zeros_of(self.game)
        if self.bits >= ATTEMPTS[-2]:
            zero_states = zero_states | _rounds_to_zero(self.P).all(1)
            zero_gains = zero_gains | _rounds_to_zero(self.K)
        zero_entries = zero_states | zero_states[:, None]
        P_middle, P_radius = np.where(zero_entries, 0.0, self.numbers("P"))
        K_middle, K_radius = np.where(zero_gains, 0.0, self.numbers("K"))
        with np.errstate(all="ignore"):
            sizes = sizes_of(P_middle)
            has_value = sizes > np.diag(P_radius)
            if not (has_value | zero_states).all():
                return Digits(math.inf, math.inf)
            roots = np.sqrt(sizes * has_value)
            of_P = _digits(P_middle, P_radius, np.outer(roots, roots))
            # K_ij is relative to √P_jj times the largest K_ik / √P_kk of the row.
            rows = np.where(has_value, np.abs(K_middle) / roots, 0.0).max(1, keepdims=True)
            of_K = _digits(K_middle, K_radius, rows * roots)
        return Digits(*map(max, of_P, of_K))


class Numbers(NamedTuple):
    """Midpoints and radii of the balls of a matrix."""

    middle: np.ndarray
    radius: np.ndarray


class Digits(NamedTuple):
    """What is known of the digits of numbers, none of which is nan.

    radius: largest relative radius of a number that is not 0
    of_zeros: bound of the numbers that may be 0, relative to √(P_ii P_jj) in P, and to √P_jj times
        the largest K_ik / √P_kk of the row in K, with |P| in place of an indefinite P
    """

    radius: float
    of_zeros: float

    @property
    def are_known(self) -> bool:
        """True if the midpoints, with 0 for what may be 0, are right to the last digit."""
        return self.radius < ALL_DIGITS and self.of_zeros < OF_ZEROS


def _digits(middle: np.ndarray, radius: np.ndarray, scales: np.ndarray) -> Digits:
    """Return the digits of balls; those that may be 0 are relative to scales."""
    sizes = np.abs(middle)
    may_be_0 = sizes <= radius
    numbers = np.where(may_be_0, 0.0, radius / sizes)
    zeros = np.where(may_be_0 & (radius > 0.0), (sizes + radius) / scales, 0.0)
    return Digits(
        *(float(np.nan_to_num(each, nan=math.inf).max(initial=0.0)) for each in (numbers, zeros))
    )


def _rounds_to_zero(matrix: arb_mat) -> np.ndarray:
    """Return for which numbers of a matrix it is proved that their nearest double is 0."""
    return np.array([[float(ball.abs_upper()) == 0.0 for ball in row] for row in matrix.tolist()])


class UndecidedError(NoSolutionError):
    """Raised if neither a value nor that there is none is proved with all bits."""


def decided(game: Game, delta: float, *, digits: bool = True) -> Enclosure | str:
    """Return the enclosure of the solution of a game, or the reason, proved, why it has no value.

    What makes the stabilizing solution the value is said in `controller.riccati.refusal`.

    delta: in place of that of the game
    digits: whether P and K must be right to the last digit of doubles

    Raises ModeError if no delta has a value because of one mode, and UndecidedError.
    """
    outcome = decided_at(game, delta, digits=digits)
    is_disturbed = math.isfinite(delta) and game.E.any()
    if isinstance(outcome, str) or not is_disturbed or has_semidefinite_weights(game):
        return outcome
    # With indefinite weights, the cost may have no lower bound even without a disturbance.
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
    """Return the enclosure of the solution of a game, or the reason, proved, why it has no value.

    The solution is the value if the game also has a value without the disturbance.

    digits: whether P and K must be right to the last digit of doubles
    near: units and states in which P is nearly the identity, if they are known
    frequency: at which the gain from the disturbance may be too large, rad/s or rad/step

    Raises ModeError and UndecidedError.
    """
    for outcome in _outcomes(game, delta, near, frequency, digits=digits):
        if outcome:  # "" is undecided with these bits
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
    """Yield what candidates prove, with more and more bits, and what rationals decide.

    An outcome is an enclosure, a reason why there is no value, or "" if nothing is proved.
    """
    # A solution in doubles, Newton's steps from it, and with twice the bits.
    with precision(BITS), np.errstate(all="ignore"):
        try:
            equation, X = proposed(game, delta, near)
            for candidate in corrections(equation, X):
                with suppress(NotProvedError):
                    yield _outcome(candidate, digits=digits)
        except FailedError:
            equation = Equation(game, near or first_units(game, delta), delta)
            yield why_no_value(equation, frequency, in_bits=False)
        else:
            with precision(2 * BITS):
                equation, balls = Equation(game, equation.units, delta), ball_matrix(candidate.X)
                with suppress(FailedError):
                    for candidate in corrections(equation, balls):
                        with suppress(NotProvedError):
                            yield _outcome(candidate.in_balls, digits=digits)
                yield why_no_value(equation, frequency, in_bits=False)
    with precision(2 * BITS):
        refuse_modes(game)  # a mode because of which no delta has a value
    # Candidates in bits.
    for n_bits in ATTEMPTS:
        with precision(n_bits), np.errstate(all="ignore"):
            equation = Equation(game, first_units(game, delta), delta)
            try:
                candidate = candidate_in_bits(game, delta)
                equation = candidate.equation
                yield _outcome(candidate, digits=digits)
            except (FailedError, NotProvedError):
                if len(game.A) > MOST_STATES_IN_BITS:
                    return
                yield why_no_value(equation, in_bits=True)


@lru_cache(maxsize=8)
def enclosed_in_bits(enclosure: Enclosure, n_bits: int) -> Enclosure:
    """Return an enclosure with at least this number of bits.

    Raises NotProvedError.
    """
    if n_bits <= enclosure.bits:
        return enclosure
    delta = enclosure.proved.equation.delta
    with precision(n_bits), np.errstate(all="ignore"):
        equation = Equation(enclosure.game, enclosure.units, delta)
        try:
            *_, candidate = corrections(equation, enclosure.proved.P)
            return enclosure_of(candidate.in_balls)
        except FailedError as failure:
            raise NotProvedError(str(failure)) from None


def enclosure_of(candidate: Candidate) -> Enclosure:
    """Return the enclosure about a candidate, proved to be the value of the game provided that the
    game without disturbance has a value.

    Raises NotProvedError.
    """
    outcome = _outcome(candidate, digits=False)
    if isinstance(outcome, str):
        raise NotProvedError(outcome)
    return outcome


def _outcome(candidate: Candidate, *, digits: bool) -> Enclosure | str:
    """Return what a candidate proves: an enclosure, a reason why there is no value, or "" if P and
    K must be right to the last digit, and may not be.

    digits: whether they must be

    Raises NotProvedError if it proves neither.
    """
    found = stabilizing(candidate)
    if reason := why_not_the_value(found):
        return reason
    enclosure = Enclosure(found.equation.game, found.equation.units, found, bits())
    return "" if digits and not enclosure.digits.are_known else enclosure


#: Largest relative change of P and K that their data determine: two digits are known.
TWO_DIGITS = 0.01


@dataclass(frozen=True, eq=False)
class Certificate(Result):
    """What is proved of a solution, in ball arithmetic, for the exact entries of the game.

    enclosure: balls of the solution
    """

    enclosure: Enclosure

    @cached_property
    def data_change(self) -> float:
        """Largest change of the sum of the relative changes of all P_ii, to the first order, where
        each entry of the game changes in its last digit; inf if that fails.

        P changes by Z of F'Z + Z F + c = 0, where c has the changes of the entries times P, K and
        L. With V of F V + V F' + W = 0 and W = diag(1 / P_ii), the sum is tr(W Z) = tr(V c), which
        is linear in each entry: the magnitudes of its factors are added. Likewise in discrete time.
        """
        change = math.inf
        with np.errstate(all="ignore"), precision(self.enclosure.bits), suppress(FailedError):
            change = _first_order_change(self.enclosure)
        return change if math.isfinite(change) else math.inf

    @cached_property
    def proved(self) -> tuple[str, ...]:
        """What is proved, in sentences."""
        return tuple(_sentences(self))

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "ok": True,
            "proved": self.proved,
            "radius": self.enclosure.digits.radius,
            "bits": self.enclosure.bits,
            "data_change": self.data_change,
        }


def has_indefinite_weights(game: Game) -> bool:
    """Return whether [[Q, N], [N', R]] is indefinite beyond rounding."""
    return least_scaled_eigenvalue(game.weights) < -SYMMETRIC


def _sentences(certificate: Certificate) -> Iterator[str]:
    """Yield sentences on what is proved: digits, stable loops, the sign of P, indefinite weights,
    last digits that decide, and the weight of the disturbance.
    """
    enclosure = certificate.enclosure
    equation, game = enclosure.proved.equation, enclosure.game
    stable = "stable" if game.is_discrete else "Hurwitz"
    loops: tuple[str, ...] = ("A - B K + E L", "A - B K") if equation.is_disturbed else ("A - B K",)
    if game.discount != 1.0:
        loops = tuple(f"sqrt(discount) ({loop})" for loop in loops)
    radius, of_zeros = enclosure.digits
    zeros = f"; what is 0 is below {of_zeros:.1g} of its row" if of_zeros else ""
    yield (
        f"P and K are right to the last digit (enclosed with the radius {radius:.1g},"
        f" {enclosure.bits} bits{zeros})"
    )
    has_no_negative_cost = has_semidefinite_weights(game)
    with precision(enclosure.bits):
        is_positive = has_no_negative_cost or is_positive_definite(enclosure.proved.P)
    sign = ", and P is positive semidefinite" if is_positive else ""
    yield f"{' and '.join(loops)} {'are' if len(loops) > 1 else 'is'} {stable}{sign}"
    if has_indefinite_weights(game):
        yield "the weights are indefinite: optimal among policies under which the state goes to 0"
    if warning := warning_of(certificate.data_change):
        yield warning
    if equation.is_disturbed:
        if game.is_discrete:
            yield "the disturbance pays: delta^2 - E'P E > 0"
        if math.isfinite(of_L := _radius_of_L(enclosure)):
            yield f"L is enclosed with the radius {of_L:.1g}"


def _radius_of_L(enclosure: Enclosure) -> float:
    """Return the largest radius of L, relative to the largest entry of its row in units of powers
    of two; inf if no digit of a row is known.
    """
    L, radius = enclosure.numbers("L")
    with np.errstate(all="ignore"):
        relative = np.where(radius > 0.0, radius / np.abs(L).max(1, keepdims=True), 0.0)
    return float(np.nan_to_num(relative, nan=math.inf).max())


def warning_of(change: float) -> str:
    """Return that the last digits of a game decide on its solution, as one sentence, or "".

    change: `data_change` of the solution
    """
    if change <= TWO_DIGITS:
        return ""
    if change < 1.0:
        return f"the last digits of the data change the solution by up to {100.0 * change:.2g} %"
    return "the last digits of the data decide on the solution, which may not exist"


def _first_order_change(enclosure: Enclosure) -> float:
    """Return Σ |∂(tr V c) / ∂entry| eps |entry| over all entries (`Certificate.data_change`).

    nan or inf if numbers overflow.

    Raises FailedError.
    """
    game, (states, inputs, disturbances, exact_T) = enclosure.game, enclosure.units
    # P, K, L, V and W are those of the states y in units of the proof, F is that of T y.
    P, K, L = (enclosure.numbers(name).middle for name in "PKL")
    sizes = sizes_of(P)
    is_known = sizes > np.diag(enclosure.numbers("P").radius)  # other P_ii may be 0
    W = np.diag(np.where(is_known, 1.0 / np.where(is_known, sizes, 1.0), 0.0))
    equation, _, gains, _ = enclosure.proved
    loop, T = equation.loop(gains), np.eye(len(P))
    T_inverse = T
    if exact_T is not None:
        T, T_inverse = midpoints(exact_T), midpoints(exact_T.inv())
    # V solves F V + V F' + W = 0, which is solved in the states T y of F.
    W_of_Ty, is_discrete = T @ W @ T.T, equation.is_discrete
    V_of_Ty = midpoints(
        solved_in_bits(loop.transpose(), ball_matrix(W_of_Ty), is_discrete=is_discrete)
    )
    V = T_inverse @ V_of_Ty @ T_inverse.T
    # Changes of A, B and E count as 2 Σ (P V)_ij dF_ij, in discrete time with P F V in place of
    # P V, where dF = √α (dA - dB K + dE L).
    of_F = P @ (T_inverse @ midpoints(loop) @ T @ V if equation.is_discrete else V)
    twice = 2.0 * math.sqrt(game.discount) * of_F
    # tr(V c), term by term: what a change of a matrix is multiplied by, the matrix, units of both
    # sides
    terms = (
        (twice, game.A, -states, states),
        (twice @ K.T, game.B, -states, inputs),
        (twice @ L.T, game.E, -states, disturbances),
        (V, game.Q, states, states),
        (2.0 * V @ K.T, game.N, states, inputs),
        (K @ V @ K.T, game.R, inputs, inputs),
    )
    total = sum(
        float((np.abs(factor) * np.abs(np.ldexp(matrix, np.add.outer(rows, columns)))).sum())
        for factor, matrix, rows, columns in terms
    )
    return np.finfo(float).eps * total
