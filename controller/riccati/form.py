"""A game in the coordinates in which it is solved, and Newton's method for its Riccati equation."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import ClassVar, NamedTuple, Self

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import largest, largest_or_1, loop_check, units_of
from controller.riccati.double_double import exact, product_of_doubles
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_least, at_most

RESIDUAL = 1e-10
#: Magnitude of a negative eigenvalue of P, relative to the largest entry, that counts as rounding.
INDEFINITENESS = 1e-10
#: A refusal names a mode whose reach or whose cost in Q is below this fraction of the largest rate.
BARELY = 1e-10
#: A mode that is reached, or that costs, by less than this fraction does so by rounding alone.
ROUNDED = 1e-14
#: Eigenvalues of X between this and its inverse are near enough to 1,
MODERATE = 1e4
#: which takes at most so many turns of the states.
TURNS = 3
#: The price of an input below this fraction of the largest is the square of a rounding.
UNPAID = 1e-28
#: An eigenvalue of X below this fraction of the largest is rounding.
RANK = 1e-13
#: Largest number of Newton steps. Each gains about 16 digits minus those lost to the condition
#: number; two are enough except near the smallest delta.
REFINEMENTS = 12
#: After a relative correction of this size, the next one is rounding, as each gains as many digits.
LAST_CORRECTION = 1e-9
#: p, the cost of the final state of a doubling, smaller than in most games in balanced units.
LAST = 2.0**-4
#: Largest number of doublings; 5 to 10 are usual.
DOUBLINGS = 60
#: Largest entry of the loop of 2^k steps after which their number no longer changes the cost.
DECAYED = 1e-8
UNREACHED = (
    "within 1e-10 of its largest rate, (A, B) is not stabilizable: no input reaches the {}; change"
    " B or leave that mode out of A"
)
HIDDEN = (
    "within 1e-10 of its size, (A, Q) is not detectable: the undamped {} has no cost; give it"
    " weight in Q"
)


class Answer(NamedTuple):
    """Answer to the question whether the game has a solution at one δ.

    exists: whether it has one
    reason: why not
    excess: number that passes through 0 at the smallest δ, or nan if none is known
    """

    exists: bool
    reason: str = ""
    excess: float = math.nan


class Turn(NamedTuple):
    """Change of the states to D W'y.

    W: (n, n), orthogonal up to rounding
    D: (n,), powers of two
    """

    W: np.ndarray
    D: np.ndarray


@dataclass(frozen=True, eq=False)
class Form(ABC):
    """Game in balanced states y = T z and inputs v, u = V v - F z, without discount.

    X is the solution of its Riccati equation, and P = T'X T that of the user's game. The discount
    is taken into √α A, √α B and √α E. All units are decided here: in any units of the user, a form
    has the same computations.

    A: (n, n)
    inputs: (n, m), B
    disturbance: (n, k), E before its division by delta
    Q: (n, n)
    R: (m, m)
    N: (n, m), 0 in continuous time, where F takes its place
    F: (m, n), R⁻¹ N' for the user's states and inputs, 0 in discrete time, where R may be singular
    T: (n, n), of powers of two in `balanced` units, so that the change of units does not round
    V: (m, m), after which the `price` is nearly the identity
    delta: delta of the game
    """

    is_discrete: ClassVar[bool]
    equation: ClassVar[str]  # in messages, as is all below
    of_matrix: ClassVar[str]  # ending of the names of modes
    loop_words: ClassVar[tuple[str, str]]  # the loops with and without disturbance

    A: np.ndarray
    inputs: np.ndarray
    disturbance: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    N: np.ndarray
    F: np.ndarray
    T: np.ndarray
    V: np.ndarray
    delta: float

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, game: Game) -> Self:
        """Return the balanced form of a game, cached for each game."""
        root = math.sqrt(game.discount)
        form = cls(
            A=root * game.A,
            inputs=root * game.B,
            disturbance=root * game.E,
            Q=game.Q,
            R=game.R,
            N=game.N,
            F=np.zeros_like(game.N.T),
            T=np.eye(len(game.A)),
            V=np.eye(len(game.R)),
            delta=game.delta,
        )
        return form._priced().without_cross_weights().balanced()

    @abstractmethod
    def without_cross_weights(self) -> Self:
        """Return the game with N = 0, if its equation needs this."""

    @abstractmethod
    def effect(self) -> np.ndarray:
        """Return B R⁻¹ B' (n, n), in discrete time with a price of the inputs in place of R."""

    @property
    def units(self) -> np.ndarray:
        """Units of the states of a balanced form, (n,): z_i = units_i y_i."""
        return 1.0 / np.diag(self.T)

    @cached_property
    def E(self) -> np.ndarray:
        """E scaled to δ = 1, (n, k)."""
        return self.disturbance / self.delta

    @property
    def weights(self) -> np.ndarray:
        """Matrix [[Q, N], [N', R]] of the cost rate, (n + m, n + m)."""
        return np.block([[self.Q, self.N], [self.N.T, self.R]])

    def with_delta(self, delta: float) -> Self:
        """Return the same game with another delta, in the same coordinates."""
        return replace(self, delta=delta)

    def balanced(self) -> Self:
        """Return the game in units of the states in which its terms are of similar size.

        The form must not be turned.
        """
        return self._in_units(units_of(self.A, self.effect() + self.E @ self.E.T, self.Q))

    @property
    @abstractmethod
    def price(self) -> np.ndarray:
        """R, in discrete time with the least cost of the next state, (m, m)."""

    def _priced(self) -> Self:
        """Return the game with inputs whose price is nearly the identity, rounded once, from twice
        the digits.

        Without this, R⁻¹ of an R that is nearly singular would be rounding.
        """
        form = self
        for number in range(TURNS):
            prices = np.diag(form.price)
            least = UNPAID * prices.max() if number else 0.0  # at first, the units are the user's
            form = form._with_inputs(np.diag(_power_of_two(prices, prices > least)))
            values, vectors = np.linalg.eigh(form.price)
            known = values > len(values) * np.finfo(float).eps * values[-1]
            if not known.any() or values[known].max() < 4.0 * values[known].min():
                break
            form = form._with_inputs(vectors * _power_of_two(values, known))
        return form

    def _with_inputs(self, V: np.ndarray) -> Self:
        """Return the game with inputs v, for which the inputs of this one are V v."""
        R = (exact(V.T) @ exact(self.R) @ exact(V)).high
        return replace(
            self,
            inputs=product_of_doubles(self.inputs, V).high,
            R=(R + R.T) / 2.0,
            N=product_of_doubles(self.N, V).high,
            V=self.V @ V,
        )

    def _in_units(self, units: np.ndarray) -> Self:
        """Return the game in states y / units, without rounding."""
        rows = units[:, None]
        return replace(
            self,
            A=self.A * units / rows,
            inputs=self.inputs / rows,
            disturbance=self.disturbance / rows,
            Q=self.Q * units * rows,
            N=self.N * rows,
            T=self.T / rows,
        )

    def turned(self, turn: Turn) -> Self:
        """Return the game in the states D W'y, rounded once, from twice the digits."""
        W = turn.W
        defect = exact(np.eye(len(W))) + -product_of_doubles(W.T, W)
        back = exact(W) + exact(W) @ defect  # (W')⁻¹ by a step of Newton's method
        into = exact(W.T)
        Q = (back.mT @ exact(self.Q) @ back).high
        return replace(
            self,
            A=(into @ exact(self.A) @ back).high,
            inputs=product_of_doubles(W.T, self.inputs).high,
            disturbance=product_of_doubles(W.T, self.disturbance).high,
            Q=(Q + Q.T) / 2.0,
            N=(back.mT @ exact(self.N)).high,
            T=W.T @ self.T,
        )._in_units(1.0 / turn.D)

    def levelling(self, X: np.ndarray, moderate: float) -> Turn | None:
        """Return the turn to states in which the solution X is nearly the identity, or None.

        Directions in which X is only rounding keep their units.

        moderate: None is returned if all eigenvalues of X are between 1 / moderate and moderate
        """
        if not np.isfinite(X).all():
            return None
        sizes, W = np.linalg.eigh((X + X.T) / 2.0)
        known = sizes > RANK * sizes[-1]
        if not known.any():
            return None
        if sizes[known].min() > 1.0 / moderate and sizes[-1] < moderate:
            return None
        return Turn(W, 1.0 / _power_of_two(sizes, known))

    def perturbed_by_rounding(self) -> Self:
        """Return the game with its entries changed as by rounding, to show how much K changes.

        Each entry of A, B and E is multiplied by a factor f = 1 ± eps, and the entries ij of Q, N
        and R by f_i f_j, with which the weights remain semidefinite.
        """
        sizes = self.A.size, self.inputs.size, self.disturbance.size
        factors = _rounding_factors(sum(sizes))
        A_factors, B_factors, E_factors = np.split(factors, np.cumsum(sizes[:2]))
        state_factors = A_factors[: len(self.A)]
        input_factors = B_factors[: len(self.R)]
        return replace(
            self,
            A=self.A * A_factors.reshape(self.A.shape),
            inputs=self.inputs * B_factors.reshape(self.inputs.shape),
            disturbance=self.disturbance * E_factors.reshape(self.disturbance.shape),
            Q=self.Q * state_factors * state_factors[:, None],
            N=self.N * input_factors * state_factors[:, None],
            R=self.R * input_factors * input_factors[:, None],
        )

    def of_value(self, P: np.ndarray) -> np.ndarray:
        """Return the X of a balanced form that belongs to P (..., n, n) of the user."""
        return P * np.outer(self.units, self.units)

    def value(self, X: np.ndarray) -> np.ndarray:
        """Return the P (n, n) of the user that belongs to X, symmetric."""
        P = self.T.T @ X @ self.T
        return (P + P.T) / 2.0

    @abstractmethod
    def gains(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return K (m, n) and L (k, n) of v = -K y and d = L y, the policies of the value y'X y."""

    def policies(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return K (m, n) and L (k, n) of u = -K z and d = L z of the user."""
        K, L = self.gains(X)
        return self.V @ K @ self.T + self.F, L @ self.T

    @abstractmethod
    def relative_residual(self, X: np.ndarray) -> float:
        """Return the largest residual of the Riccati equation for X, relative to its terms."""

    @abstractmethod
    def newton_step(self, X: np.ndarray) -> np.ndarray:
        """Return the Newton correction of X, from a residual in twice the precision.

        Corrections by such residuals converge to the rounding of X (Wilkinson's iterative
        refinement). Raises NoSolutionError if its equation is singular within rounding.
        """

    def refined(self, X: np.ndarray) -> np.ndarray:
        """Return the X after the smallest of several Newton corrections of the symmetric part of X.

        Raises NoSolutionError as `newton_step` does.
        """
        best = X = (X + X.T) / 2.0
        smallest = math.inf
        for _ in range(REFINEMENTS):
            with np.errstate(all="ignore"):  # an overflow is refused
                correction = self.newton_step(X)
            X = X + correction
            size = largest(correction)
            if size < smallest:
                best, smallest = X, size
            if size <= LAST_CORRECTION * largest(X):
                break
        return best

    @abstractmethod
    def unrefined(self) -> np.ndarray:
        """Return X from a stable subspace. Raises NoSolutionError if it has none."""

    def levelled(self) -> tuple[Self, np.ndarray, list[Turn]]:
        """Return the game in states in which no eigenvalue of X is far from 1, its X, not refined,
        and the turns to these states.

        A turn that ends in an indefinite X is left out: small eigenvalues of X were rounding.

        Raises NoSolutionError if the game has no stable subspace.
        """
        form, X = self, self.unrefined()
        turns: list[Turn] = []
        while len(turns) < TURNS and (turn := form.levelling(X, MODERATE)):
            turned = form.turned(turn)
            try:
                levelled_X = turned.unrefined()
            except NoSolutionError:
                break
            sizes = np.linalg.eigvalsh((levelled_X + levelled_X.T) / 2.0)
            if not sizes[0] >= -sizes[-1] / MODERATE:
                break
            form, X = turned, levelled_X
            turns.append(turn)
        return form, X, turns

    @abstractmethod
    def by_doubling(self) -> np.ndarray:
        """Return X by a doubling algorithm, not refined.

        Raises NoSolutionError if a matrix is singular.
        """

    @abstractmethod
    def axis_checks(self) -> tuple[Check, ...]:
        """Return the checks that half of the spectrum is stable, as far as a form makes them."""

    def checks(self, X: np.ndarray) -> tuple[Check, ...]:
        """Return the checks of X: its equation, its sign, `more_checks`, and both closed loops.

        If X is not finite, only a failed check of the equation is returned. Raises NoSolutionError
        if a matrix is singular.
        """
        if not np.all(np.isfinite(X)):
            return (at_most("residual", np.nan, RESIDUAL, "P has entries that are not finite"),)
        residual = self.relative_residual(X)
        unsolved = f"the residual of {self.equation} is {residual:.2g}"
        smallest = float(np.linalg.eigvalsh((X + X.T) / 2.0)[0] / largest_or_1(X))
        indefinite = (
            f"the computed P is indefinite (smallest eigenvalue {smallest:.3g} of its size)"
        )
        game_loop, control_loop = self.loops(X)
        of_game, of_control = self.loop_words
        return (
            at_most("residual", residual, RESIDUAL, unsolved),
            at_least("positive_semidefinite", smallest, -INDEFINITENESS, indefinite),
            *self.more_checks(X),
            loop_check("game_loop", of_game, game_loop, is_discrete=self.is_discrete),
            loop_check("control_loop", of_control, control_loop, is_discrete=self.is_discrete),
        )

    @abstractmethod
    def loops(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the loop with both policies of X, (n, n), and that without disturbance."""

    def more_checks(self, X: np.ndarray) -> tuple[Check, ...]:
        """Return the checks of X that only one kind of time has."""
        return ()

    @abstractmethod
    def existence(self) -> Answer:
        """Return whether the game has a value at this delta, and the reason if not."""

    @property
    @abstractmethod
    def without_input(self) -> tuple[np.ndarray, np.ndarray]:
        """A and Q of the game with the input that costs least at each state."""

    @property
    @abstractmethod
    def reach(self) -> np.ndarray:
        """Effect of the inputs on the states, in the units of the inputs that the form uses."""

    @abstractmethod
    def beyond(self, value: complex) -> tuple[float, complex]:
        """Return how far an eigenvalue λ of A is beyond the boundary of stability, and the nearest
        point of the boundary.
        """

    def obstacle(self, barely: float = BARELY) -> str:
        """Return the mode because of which no delta has a solution, as one sentence, or "".

        The Riccati equation without disturbance has a stabilizing solution if and only if two
        matrices have full column rank:

        - [A' - λI; B'] for every eigenvalue λ of A that is not stable, else no input reaches a mode
        - [A - λI; Q] for every λ on the boundary of stability, else a mode has no cost

        barely: fraction of the largest rate below which a mode is not reached, or costs nothing

        Source: Zhou, Doyle and Glover, Theorem 13.7.
        """
        A, Q = self.without_input
        size = float(np.linalg.norm(A, 2)) or 1.0
        for mode in modes_of(A):
            excess, on_boundary = self.beyond(mode.value)
            if excess < -mode.rounding:
                continue
            if dependence(A, mode.value, self.reach.T, size) <= barely:
                return UNREACHED.format(f"{mode}{self.of_matrix}")
            is_undamped = excess <= mode.rounding
            if is_undamped and dependence(A.T, on_boundary, Q, size) <= barely:
                return HIDDEN.format(f"{mode}{self.of_matrix}")
        return ""


def _power_of_two(sizes: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the powers of two next to sizes^-½, (m,), and 1 for sizes that are not known."""
    return np.exp2(np.round(-0.5 * np.log2(np.where(known, sizes, 1.0))))


@lru_cache(maxsize=8)
def _rounding_factors(count: int) -> np.ndarray:
    """Return 1 ± eps, (count,), with the signs of sin(k² + 1), which have no pattern."""
    k = np.arange(count)
    return np.asarray(1.0 + np.finfo(float).eps * np.sign(np.sin(k**2 + 1.0)))


class Mode(NamedTuple):
    """Eigenvalue λ of a matrix.

    value: λ
    rounding: change of λ by rounding of the matrix
    """

    value: complex
    rounding: float

    def __str__(self) -> str:
        """Return the name of the mode for a message, "mode with eigenvalue 0.5 ± 1i"."""
        parts = self.value.real, self.value.imag
        real, imaginary = (part if abs(part) > self.rounding else 0.0 for part in parts)
        pair = f" ± {abs(imaginary):.4g}i" if imaginary else ""
        return f"mode with eigenvalue {real:.4g}{pair}"


def modes_of(A: np.ndarray) -> list[Mode]:
    """Return the eigenvalues of A (n, n) with their roundings, n² eps |A| / |y'x| with the
    eigenvectors x and y, at most 1e-6 |A|, the rounding of a double eigenvalue.
    """
    from scipy.linalg import eig

    values, left, right = eig(A, left=True)
    size = float(np.linalg.norm(A, 2))
    aligned = np.abs(np.vecdot(left.T, right.T))
    with np.errstate(divide="ignore"):
        roundings = len(A) ** 2 * np.finfo(float).eps * size / aligned
    return list(map(Mode, values.tolist(), np.minimum(roundings, 1e-6 * size).tolist()))


def dependence(A: np.ndarray, value: complex, rows: np.ndarray, size: float) -> float:
    """Return the smallest singular value of [A' - λI; rows], relative to the norm of A.

    The rows are first scaled to the norm of A. If the matrix does not have full column rank, the
    result is of the order of rounding.

    A: (n, n)
    value: λ
    rows: (p, n)
    size: norm of A
    """
    scaled = size * (rows / (float(np.linalg.norm(rows, 2)) or 1.0))
    stacked = np.vstack([A.T - value * np.eye(len(A)), scaled])
    return float(np.linalg.svd(stacked, compute_uv=False)[-1]) / size


def doubled(A: np.ndarray, S: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """Return the cost of a game over all steps, (n, n), by doubling the number of steps.

    With V = (I + S Y)^-1, each doubling replaces

    Y <- Y + A'Y V A,  S <- S + A V S A',  A <- A V A

    A: loop of a step, (n, n)
    S: effect of the policies on the states after a step, (n, n)
    Y: cost of a step, (n, n)

    Source: Chu, Fan, Lin and Wang, Int. J. Control 77 (2004).

    Raises LinAlgError if a matrix is singular.
    """
    one = np.eye(len(A))
    for _ in range(DOUBLINGS):
        V = np.linalg.inv(one + S @ Y)
        AV = A @ V
        Y, S, A = Y + A.T @ Y @ V @ A, S + AV @ S @ A.T, AV @ A
        if np.abs(A).max() <= DECAYED:
            break
    return Y
