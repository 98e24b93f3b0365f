"""Zero-sum games on a linear model, in continuous or in discrete time: the cost, and the policies
that follow from a value."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.signals import UNNAMED, PlantNames
from hfa_support.arguments import ArrayLike
from hfa_support.cached import cached_property
from hfa_support.errors import (
    BadInputError,
    is_finite,
    numbers_in,
    refuse_unknown,
    refuse_unless_positive,
    shown,
)
from hfa_support.matrices import LARGEST, balanced, checked_matrix, power_of_two, shape_text
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import ByValue

#: Larger entries of a critic overflow when P S P is squared, and are meaningless.
LARGEST_CRITIC_ENTRY = 1e50
#: Largest relative asymmetry of weights: some thousand roundings, as of a file with 13 digits.
SYMMETRIC = 1e-12
#: Smallest sample time, multiplied by the largest entry of A. The entries of A - I of a step have
#: then at least ten digits.
SHORTEST = 1e-6


@dataclass(frozen=True, eq=False, repr=False)
class Game(ByValue, Reported):
    """Zero-sum game J = ∫ z'Qz + 2z'Nu + u'Ru - δ² d'd dt, z' = A z + B u + E d (paper Eq. 15-16).

    The input u minimizes J, and the disturbance d maximizes J. In the paper, N = 0. With dt, time
    is discrete: z⁺ = A z + B u + E d, J = Σ αᵏ (z'Qz + 2z'Nu + u'Ru - δ² d'd).

    A: (n, n)
    B: (n, m)
    E: (n, k), disturbance matrix; by default the identity, as in the paper
    Q: (n, n), symmetric; or its diagonal, (n,), or state -> weight, with 0 for all other states
    R: (m, m), symmetric, in continuous time positive definite; or its diagonal, (m,), or
        input -> weight, for every input
    delta: δ > 0; by default inf (LQR without a disturbance)
    N: (n, m), cross weights; by default 0
    names: names of the states and inputs in reports; by default x1, x2, ... and u1, u2, ...
    half_widths: (n,), largest box of states about the trim within the limits of the model, in which
        critics are compared; None if unknown
    dt: None, or 0, for continuous time; in discrete time the sample time, s, or True if it is not
        known, as in python-control
    discount: α of one step, 0 < α <= 1; 1 in continuous time

    Raises BadInputError if a matrix has a wrong shape, is not definite as required, or contains a
    number that is not finite or is too large.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> game.S.tolist()
    [[0.75]]
    """

    A: np.ndarray
    B: np.ndarray
    _: KW_ONLY
    E: np.ndarray = None  # type: ignore[assignment]  # becomes the identity
    Q: np.ndarray = None  # type: ignore[assignment]  # required
    R: np.ndarray = None  # type: ignore[assignment]  # required
    delta: float = np.inf
    N: np.ndarray = None  # type: ignore[assignment]  # becomes 0
    names: PlantNames = field(default=UNNAMED, compare=False)
    half_widths: np.ndarray | None = field(default=None, compare=False)
    dt: float | bool | None = None
    discount: float = 1.0

    if TYPE_CHECKING:

        def __init__(
            self,
            A: ArrayLike,
            B: ArrayLike,
            *,
            Q: ArrayLike | Mapping[str, float] | None = None,
            R: ArrayLike | Mapping[str, float] | None = None,
            E: ArrayLike | None = None,
            delta: float = np.inf,
            N: ArrayLike | None = None,
            names: PlantNames = UNNAMED,
            half_widths: np.ndarray | None = None,
            dt: float | bool | None = None,
            discount: float = 1.0,
        ) -> None: ...

    def __post_init__(self) -> None:
        """Check all fields, and replace diagonals of Q and R by matrices and missing fields by
        defaults.

        Raises BadInputError, as described for the class.
        """
        if not isinstance(self.names, PlantNames):
            raise BadInputError(
                f"names is {shown(self.names)}; name the signals by hfa.game(hfa.LinearModel.of(A, "
                "B, states=[...], inputs=[...]), Q=Q, R=R)"
            )
        if self.Q is None or self.R is None:
            raise BadInputError("Q or R is missing; write Game(A, B, Q=..., R=...)")
        # The dataclass is frozen: vars(self) sets its fields.
        if self.E is None:
            vars(self)["E"] = np.eye(len(np.atleast_1d(numbers_in("A", self.A))))
        for name in ("Q", "R"):
            vars(self)[name] = self._weight_matrix(name, getattr(self, name))
        for name in ("A", "B", "E", "Q", "R"):
            vars(self)[name] = checked_matrix(name, getattr(self, name), LARGEST)
        N = np.zeros(self.B.shape) if self.N is None else self.N
        vars(self)["N"] = checked_matrix("N", N, LARGEST)
        _refuse_other_shapes(self)
        vars(self).update(_checked_numbers(self.delta, self.dt, self.discount))
        for name, weight in (("Q", self.Q), ("R", self.R)):
            if np.abs(weight - weight.T).max() > SYMMETRIC * np.abs(weight).max():
                raise BadInputError(f"{name} is not symmetric; give a symmetric matrix")
        if self.dt is None and not is_definite(self.R):
            raise BadInputError(
                "R is not positive definite, or its diagonal has a smaller entry than"
                f" {1.0 / LARGEST:g}; give a matrix with positive eigenvalues, or other units"
            )
        vars(self)["names"] = self.names.completed(*self.B.shape)

    def _weight_matrix(self, matrix: str, given: Any) -> np.ndarray:
        """Return Q or R as a matrix, given as such, by its diagonal, or as name -> weight.

        matrix: "Q" or "R"
        """
        if not isinstance(given, Mapping):
            weights = numbers_in(matrix, given)
            return np.diag(weights) if weights.ndim == 1 else weights
        n, m = np.atleast_2d(numbers_in("B", self.B)).shape
        completed = self.names.completed(n, m)
        names = completed.states if matrix == "Q" else completed.inputs
        for name, weight in given.items():
            refuse_unknown(f"{matrix} weights an unknown name", name, names)
            if not isinstance(weight, (int, float, np.number)):
                raise BadInputError(
                    f"the {matrix} weight of {name} is {shown(weight)}; give a number"
                )
        missing = [name for name in names if name not in given]
        if matrix == "R" and missing:
            raise BadInputError(
                f"R has no weight for {', '.join(missing)}; give a weight, or size, for each input"
            )
        return np.diag([float(given.get(name, 0.0)) for name in names])

    def __hash__(self) -> int:
        """Return a hash of the sums of all entries of A, Q, R and N, and of delta.

        Equal games have equal hashes: the sums of 0.0 and of -0.0 are equal, their bytes are not.
        """
        return hash((*map(np.sum, (self.A, self.Q, self.R, self.N)), self.delta))

    @cached_property
    def weights(self) -> np.ndarray:
        """Matrix [[Q, N], [N', R]] of the cost rate of (z, u), (n + m, n + m)."""
        return np.block([[self.Q, self.N], [self.N.T, self.R]])

    @property
    def is_discrete(self) -> bool:
        """True for a game in discrete time."""
        return self.dt is not None

    @cached_property
    def F(self) -> np.ndarray:
        """F = R⁻¹ N', (m, n). With v = u + F z, the cost rate is z'(Q - N R⁻¹ N')z + v'R v."""
        return self._over_R(self.N.T)

    def _over_R(self, matrix: np.ndarray) -> np.ndarray:
        """Return R⁻¹ times a matrix, or R⁺ if R is singular, as it may be in discrete time."""
        if self.is_discrete and not is_definite(self.R):
            return np.linalg.pinv(self.R) @ matrix
        return np.linalg.solve(self.R, matrix)

    @cached_property
    def without_cross_weights(self) -> Game:
        """The same game with the input v = u + F z, the matrices A - B F, Q - N R⁻¹ N', and N = 0.

        Both games have the same value, worst disturbance and closed loop. The gain of v is K - F.
        """
        if not self.N.any():
            return self
        Q = self.Q - self.N @ self.F
        return replace(self, A=self.A - self.B @ self.F, Q=(Q + Q.T) / 2.0, N=0.0 * self.N)

    @cached_property
    def R_inverse_B_transposed(self) -> np.ndarray:
        """R⁻¹ B', (m, n). The policy of the value V is u = -½ R⁻¹ B' ∂V/∂z - F z, F = R⁻¹ N'."""
        return self._over_R(self.B.T)

    @cached_property
    def S_control(self) -> np.ndarray:
        """B R⁻¹ B', (n, n), the term of the control in S."""
        return self.B @ self.R_inverse_B_transposed

    @cached_property
    def S(self) -> np.ndarray:
        """S = B R⁻¹ B' - δ⁻² E E', (n, n): the quadratic term of the Riccati equation for N = 0."""
        return self.S_control - self.E @ self.E.T / self.delta**2

    def gain(self, P: np.ndarray) -> np.ndarray:
        """Return K (m, n) of the policy u = -K z of the value z'P z (`policies`)."""
        return self.policies(P)[0]

    def disturbance_gain(self, P: np.ndarray) -> np.ndarray:
        """Return L (k, n) of the worst disturbance d = L z for the value z'P z (`policies`)."""
        return self.policies(P)[1]

    def policies(self, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return K (m, n) and L (k, n) of the policies u = -K z and d = L z of the value z'P z.

        In continuous time, K = R⁻¹(B'P + N') and L = δ⁻² E'P. In discrete time, the policies are
        optimal for one step, followed by the cost z'P z:

          [K; -L] = H_aa⁻¹ H_ax,  a = (u, w), with H of the Q-function (`q_function`)

        Both are nan if no extremum exists. With δ = inf, L is 0.

        P: (n, n)
        """
        if np.shape(P) != self.A.shape:
            n = len(self.A)
            raise BadInputError(f"P is {shape_text(np.shape(P))}; give {n} x {n}, states x states")
        if not self.is_discrete:
            return self._over_R(self.B.T @ P + self.N.T), self.E.T @ P / self.delta**2
        (n, m), k = self.B.shape, self.E.shape[1]
        H = q_function(self, P)
        L = np.zeros((k, n))
        try:
            with np.errstate(all="ignore"):
                gains = np.linalg.solve(H[n:, n:], H[n:, :n])
        except np.linalg.LinAlgError:
            return np.full((m, n), np.nan), L + np.nan
        L[: len(gains) - m] = -gains[m:]
        return gains[:m], L

    def suboptimality_weight(self, P: np.ndarray) -> np.ndarray:
        """Return the weight (m, m) of u - u* in the cost above the value z'P z.

        In continuous time, it is R. In discrete time, it is R + α B'P B.
        """
        return self.R + self.discount * self.B.T @ P @ self.B if self.is_discrete else self.R

    def checked_gain(self, K: ArrayLike) -> np.ndarray:
        """Return K, (m, n), or (n,) for one input, as a matrix of floats.

        Raises BadInputError if K is not a real m x n matrix, or contains a number out of range.
        """
        K = numbers_in("K", K)
        n, m = self.B.shape
        K = K[None] if K.ndim == m == 1 else K
        if K.shape != (m, n):
            hint = ", such as the transpose of K" if K.shape == (n, m) else ""
            raise BadInputError(
                f"K is {shape_text(K.shape)}; give {m} x {n}, inputs x states{hint}"
            )
        return checked_matrix("K", K, LARGEST_CRITIC_ENTRY)

    def worst_case_loop(self, P: np.ndarray) -> np.ndarray:
        """Return A - B K + E L, (n, n), the loop with both policies of the value z'Pz.

        In continuous time with N = 0, the loop is A - S P.
        """
        K, L = self.policies(P)
        return self.A - self.B @ K + self.E @ L

    def sampled(self, dt: float, discount: float = 1.0) -> Game:
        """Return the sampled game, with constant u and d in each step of dt seconds.

        The cost of a step is dt (z'Qz + 2z'Nu + u'Ru - δ² d'd) at the beginning of the step. Thus
        the weights of the step are Q dt, R dt and N dt, and the delta of the step is √dt δ.

        Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems, Section 4.3.

        dt: sample time, s
        discount: discount of one step

        Raises BadInputError if dt is not positive, if dt is below `SHORTEST` divided by the largest
        entry of A in balanced units, or if the game is in discrete time already.
        """
        refuse_unless_positive("dt", dt, " s")
        self.refuse_steps("Game.sampled")
        n, m = self.B.shape
        step = _zero_order_hold(self.A, np.hstack([self.B, self.E]), dt)
        A, B, E = np.split(step, [n, n + m], axis=1)
        return replace(
            self,
            A=A,
            B=B,
            E=E,
            Q=self.Q * dt,
            R=self.R * dt,
            N=self.N * dt,
            delta=self.delta * math.sqrt(dt),
            dt=dt,
            discount=discount,
        )

    def select(self, inputs: Sequence[str]) -> Game:
        """Return the game in which only the named inputs move. The others stay at the trim.

        Raises BadInputError for an unknown or repeated name.
        """
        from trim.linear.reduction import positions

        kept = positions("input", inputs, self.names.inputs)
        names = self.names._replace(
            inputs=tuple(self.names.inputs[index] for index in kept),
            input_units=tuple(self.names.input_units[index] for index in kept),
        )
        R = self.R[np.ix_(kept, kept)]
        return replace(self, B=self.B[:, kept], R=R, N=self.N[:, kept], names=names)

    def with_delta(self, delta: float) -> Game:
        """Return a copy of the game with this delta."""
        return replace(self, delta=delta)

    def refuse_cross_weights(self, what: str) -> None:
        """Raise BadInputError if N is not 0.

        what: the command or function that has no cross weights, for the message
        """
        if self.N.any():
            raise BadInputError(f"{what} has no cross weights; remove N")

    def refuse_steps(self, what: str) -> None:
        """Raise BadInputError if the game is in discrete time.

        what: the command or function, for the message
        """
        if self.is_discrete:
            raise BadInputError(
                f"{what} requires a game in continuous time, but this game has dt; for a game in"
                " discrete time there are hfa.solve, hfa.learn and hfa.verify"
            )


def q_function(game: Game, P: np.ndarray) -> np.ndarray:
    """Return H (n + m + k, n + m + k) of the Q-function Q(x, u, w) = [x; u; w]'H [x; u; w].

      H = [[Q, N, 0], [N', R, 0], [0, 0, -δ² I]] + α [A B E]'P [A B E]

    With δ = inf, H is over (x, u), (n + m, n + m).

    P: (n, n)
    """
    from scipy.linalg import block_diag

    plant, weights = np.hstack([game.A, game.B]), game.weights
    if math.isfinite(game.delta):
        plant = np.hstack([plant, game.E])
        weights = block_diag(weights, -(game.delta**2) * np.eye(game.E.shape[1]))
    return np.asarray(weights + game.discount * plant.T @ P @ plant)


def _zero_order_hold(A: np.ndarray, inputs: np.ndarray, dt: float) -> np.ndarray:
    """Return [Φ Γ] (n, n + k) of the step z⁺ = Φ z + Γ v of z' = A z + B v with constant v.

    Raises BadInputError if dt is below `SHORTEST` divided by the largest entry of A in balanced
    units.

    A: rates of z per z, (n, n)
    inputs: B, rates of z per input v, (n, k)
    dt: duration of the step, s
    """
    from trim.linear.delays import zero_order_hold

    scaled_A, units = balanced(A)
    fastest = float(np.abs(scaled_A).max())
    if 0.0 < dt * fastest < SHORTEST:
        raise BadInputError(
            f"dt = {dt:g} s is too short: A of a step would differ from the identity by less"
            f" than {SHORTEST:g}, and lose its rates to rounding; give at least"
            f" {SHORTEST / fastest:.2g} s, or solve the game in continuous time"
        )
    # d/dt [z; v] = [A B; 0 0] [z; v]. With z = units y and w = sizes v,
    # y' = scaled_A y + (inputs / sizes) w has entries of similar sizes, of which the exponential
    # keeps the digits.
    inputs = inputs / units[:, None]
    sizes = power_of_two(np.abs(inputs).max(axis=0)) * (fastest or 1.0)
    step = np.hstack(zero_order_hold(scaled_A, inputs / sizes, dt))
    return np.asarray(units[:, None] * step * np.append(1.0 / units, sizes))


def rates_of_step(step: np.ndarray, dt: float) -> np.ndarray | None:
    """Return [A B], (n, n + k), of z' = A z + B v of which a step with constant v is a sample.

    The rates are the real logarithm of the step; None if an eigenvalue is 0 or negative.

    step: [Φ Γ] of z⁺ = Φ z + Γ v, (n, n + k)
    dt: duration of the step, s
    """
    from scipy.linalg import logm

    n = len(step)
    poles = np.linalg.eigvals(step[:, :n])
    if np.any((poles.imag == 0.0) & (poles.real <= 0.0)):
        return None
    whole = np.eye(step.shape[1])
    whole[:n] = step
    return np.asarray(logm(whole).real[:n] / dt)


def _refuse_other_shapes(game: Game) -> None:
    """Raise BadInputError for empty matrices, and for matrices that do not match A and B."""
    n, m, k = len(game.A), game.B.shape[1], game.E.shape[1]
    if 0 in (n, m, k):
        raise BadInputError(
            "A, B or E is empty; a game needs at least one state and one input; without a"
            " disturbance leave E and delta out"
        )
    shapes = {"A": (n, n), "B": (n, m), "E": (n, k), "Q": (n, n), "R": (m, m), "N": (n, m)}
    for name, shape in shapes.items():
        actual = getattr(game, name).shape
        if actual != shape:
            rule = "a square matrix" if name == "A" else f"{shape_text(shape)}, to match A and B"
            raise BadInputError(f"{name} is {shape_text(actual)}; give {rule}")


def _checked_numbers(delta: Any, dt: Any, discount: Any) -> dict[str, float | bool | None]:
    """Return delta, dt and the discount of a game, name -> value, of which dt = 0 is None.

    Raises BadInputError unless each is valid, as described for `Game`.
    """
    least, most = LARGEST**-0.5, LARGEST**0.5  # delta² is then within `LARGEST`
    is_number = isinstance(delta, (int, float, np.floating))
    if not is_number or not (least <= delta <= most or delta == np.inf):
        raise BadInputError(
            f"delta is {shown(delta)}; give a number from {least:g} to {most:g}, or inf"
        )
    if dt is not None and dt is not True:
        if not is_finite(dt) or dt is False or dt < 0.0:
            raise BadInputError(
                f"dt is {shown(dt)}; give the sample time in s, True if it is unknown, or None for"
                " continuous time"
            )
        dt = float(dt) or None
    if not (is_finite(discount) and 0.0 < discount <= 1.0):
        raise BadInputError(
            f"discount is {shown(discount)}; give the factor per step, a number above 0 and at "
            "most 1"
        )
    if dt is None and discount != 1.0:
        raise BadInputError("discount requires a game in discrete time; add dt, or remove discount")
    return {"delta": float(delta), "dt": dt, "discount": float(discount)}


def is_definite(matrix: np.ndarray) -> bool:
    """Return whether a symmetric matrix (n, n) is positive definite.

    Where its smallest eigenvalue may be rounding, the signs of the characteristic polynomial decide
    in rationals. Each diagonal entry must be at least 1 / `LARGEST`.
    """
    from flint import fmpq, fmpq_mat

    if np.diag(matrix).min(initial=np.inf) < 1.0 / LARGEST:
        return False
    least = least_scaled_eigenvalue(matrix)
    if abs(least) > 10 * len(matrix) * np.finfo(float).eps:
        return least > 0.0
    exact = [[fmpq(*entry.as_integer_ratio()) for entry in row] for row in matrix.tolist()]
    minus_symmetric = -(fmpq_mat(exact) + fmpq_mat(exact).transpose())
    return all(coefficient > 0 for coefficient in minus_symmetric.charpoly().coeffs())


def least_scaled_eigenvalue(matrix: np.ndarray) -> float:
    """Return the smallest eigenvalue of a symmetric matrix M, scaled to a diagonal of ones.

    The scaled matrix is M_ij / sqrt(M_ii M_jj), without the rows and columns of M that are zero.

    The result is 0 for a zero matrix, and -inf for one that is indefinite by its diagonal: with a
    negative entry there, with a 0 there in a nonzero row, or if the scaled matrix is not finite.
    """
    diagonal = np.diag(matrix)
    is_positive = diagonal > 0.0
    if matrix[~is_positive].any():  # also a negative entry of the diagonal
        return -np.inf
    if not is_positive.any():
        return 0.0
    sizes = np.sqrt(diagonal[is_positive])
    scaled = matrix[np.ix_(is_positive, is_positive)] / sizes / sizes[:, None]
    if not np.isfinite(scaled).all():  # M_ij² > M_ii M_jj by far
        return -np.inf
    return float(np.linalg.eigvalsh((scaled + scaled.T) / 2.0)[0])
