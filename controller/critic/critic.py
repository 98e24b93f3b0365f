"""Critics: learned policies u(z), and their values V(z) where known.

z is the deviation of the state from trim. A critic is a matrix, weights of a basis, or a network.
In all three cases u and V are CasADi functions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce
from operator import mul
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.features import basis_of, symbols_for
from controller.critic.network.declared import NOTHING, Declared
from controller.game.basis import Basis, bases_of_size, monomials, q_extremum
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, is_finite, numbers_in, shown
from hfa_support.matrices import checked_matrix, in_order, shape_text
from hfa_support.native.bound import RowFunction
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import Matrix

#: Largest difference between W and P of one critic, relative to sqrt(|P_ii P_jj|): the rounding of
#: six printed digits.
_ROUNDING = 1e-6
#: Possible outputs of a network: V, ∂V/∂z, u.
FUNCTIONS = ("V", "gradient", "policy")


@dataclass(frozen=True, eq=False, repr=False)
class Critic(Reported):
    """Policy u(z) and its value V(z), with the linear part u = -K z and the quadratic part z'Pz.

    K: (m, n), -∂u/∂z at z = 0
    P: (n, n), ½ ∂²V/∂z² at z = 0, or None if only a policy is known
    origin: source of the critic: "P", "K", "weights", "network FILE: 6 -> tanh 64 -> 1"
    weights: (M,), V = weights'ψ(z) + constant, or None for a critic without a `Basis`
    basis: ψ, or None without weights
    constant: V(0), or 0 if V is unknown
    precision: floating-point type of the numbers in the critic's file
    slope_gain: (m, n), R⁻¹B', if the policy follows from the value as u = -½ R⁻¹B' ∂V/∂z; None for
        an independent policy, and in discrete time
    F: (m, n), R⁻¹N' of a game with cross weights, if the policy follows from the value as
        u = -½ R⁻¹B' ∂V/∂z - F z; None for 0
    L: (k, n), gain of the learned worst disturbance d = L z, or None if none was learned
    H: matrix of the learned Q-function over (x, u, w) or (x, u) in discrete time, or None
    network: "V", "gradient" (∂V/∂z), "policy" -> CasADi Function of z, for each known function of a
        network or a list of functions; empty for all other critics
    is_layer: True for a network with one layer on a basis
    has_weights: True if the value or the policy is given by weights of functions, in `weights` or,
        for listed functions and for policy_weights, only in `network`
    is_discrete: whether the critic was made with a game in discrete time; None without a game
    is_nonsmooth: True if slopes beside z = 0 differ: K and P are means at two opposite states
    declared: what the file of a network states of its policy, and notes on what is not used

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0], delta=10.0)
    >>> critic = hfa.from_gain(game, [[2.5]])
    >>> type(critic) is hfa.Critic, critic.K.tolist()
    (True, [[2.5]])
    """

    K: Matrix
    P: Matrix | None = None
    origin: str = "K"
    weights: np.ndarray | None = None
    basis: Basis | None = None
    constant: float = 0.0
    precision: str = "float64"
    slope_gain: np.ndarray | None = None
    F: np.ndarray | None = None
    L: Matrix | None = None
    H: Matrix | None = None
    network: Mapping[str, ca.Function] = field(default_factory=dict)
    is_layer: bool = False
    has_weights: bool = False
    is_discrete: bool | None = None
    is_nonsmooth: bool = False
    declared: Declared = NOTHING

    @property
    def is_quadratic(self) -> bool:
        """True if the matrices P and K fully describe the value V and the policy u.

        - a `network`: False
        - weights: True if all weights of monomials other than z_i z_j are 0
        - a gain or a matrix P: True
        """
        if self.network:
            return False
        if self.weights is None or self.basis is None:
            return True
        return not self.weights[self.basis.quadratic_size :].any()

    @property
    def is_finite(self) -> bool:
        """True if no entry of K and P is NaN or exceeds `LARGEST_CRITIC_ENTRY` in magnitude."""
        matrices = [matrix for matrix in (self.K, self.P) if matrix is not None]
        return all(bool(np.all(np.abs(matrix) <= LARGEST_CRITIC_ENTRY)) for matrix in matrices)

    @property
    def has_linear_policy(self) -> bool:
        """True if the policy is u = -K z: of a quadratic critic, or with a separate K."""
        return not self.network and (self.slope_gain is None or self.is_quadratic)

    @property
    def linear_part(self) -> Critic:
        """Critic with the policy u = -K z and, if V is known, the value z'Pz."""
        return replace(
            self,
            weights=None,
            basis=None,
            constant=0.0,
            network={},
            is_layer=False,
        )

    @property
    def symbols(self) -> ca.SX:
        """New CasADi symbols z (n,), as arguments of the critic's functions (`symbols_for`)."""
        return symbols_for(self.network.values(), self.K.shape[1])

    @cached_property
    def policy(self) -> ca.Function:
        """CasADi Function z (n,) -> u (m,)."""
        if "policy" in self.network:
            return self.network["policy"]
        z = self.symbols
        if self.network:  # of V: u = -½ R⁻¹B' ∂V/∂z - F z
            assert self.gradient is not None
            assert self.slope_gain is not None
            u = -0.5 * ca.DM(self.slope_gain) @ self.gradient(z)
            if self.F is not None:
                u -= ca.DM(self.F) @ z
        else:
            u = -ca.DM(self.K) @ z
            if self.slope_gain is not None:  # K follows from z'Pz; this from the other terms of V
                u -= 0.5 * ca.DM(self.slope_gain) @ ca.gradient(self._beyond_quadratic(z), z)
        return ca.Function("policy", [z], [ca.densify(u)])

    @cached_property
    def value(self) -> ca.Function | None:
        """CasADi Function z (n,) -> V, or None if V is unknown."""
        if self.network:
            return self.network.get("V")
        if self.P is None:
            return None
        z = ca.SX.sym("z", len(self.P))
        V = ca.bilin(ca.DM(self.P), z, z) + self._beyond_quadratic(z) + self.constant
        return ca.Function("value", [z], [V])

    @cached_property
    def gradient(self) -> ca.Function | None:
        """CasADi Function z (n,) -> ∂V/∂z (n,), or None if only a policy is known."""
        if "gradient" in self.network:
            return self.network["gradient"]
        if self.value is None:
            return None
        z = self.symbols
        return ca.Function("gradient", [z], [ca.densify(ca.gradient(self.value(z), z))])

    def u(self, z: ArrayLike) -> np.ndarray:
        """Return the inputs u(z), (m,) or (N, m), at deviations z of the state, (n,) or (N, n).

        Raises BadInputError for another shape.
        """
        rows = numbers_in("z", z)
        n = self.K.shape[1]
        if rows.ndim not in (1, 2) or rows.shape[-1] != n:
            raise BadInputError(f"z has shape {rows.shape}; give ({n},) or (N, {n})")
        (u,) = self._policy_of_rows(np.atleast_2d(rows))
        return u.reshape(*rows.shape[:-1], -1)

    @cached_property
    def _policy_of_rows(self) -> RowFunction:
        """The policy as a function of rows z (N, n) -> u (N, m)."""
        return RowFunction(self.policy)

    def _beyond_quadratic(self, z: ca.SX) -> ca.SX:
        """Return W'ψ(z) without the monomials z_i z_j, as an expression of z."""
        if self.weights is None or self.basis is None or self.is_quadratic:
            return ca.SX(0.0)
        first = self.basis.quadratic_size
        terms = monomials_of(z, self.basis.exponents[first:])
        return ca.dot(ca.DM(self.weights[first:]), terms)


def monomials_of(z: ca.SX, exponents: np.ndarray) -> ca.SX:
    """Return the monomials of z with these exponents (M, n) as expressions, (M,)."""
    states, one = ca.vertsplit(z), ca.SX(1.0)
    factors_of_monomials = [
        [state**power for state, power in zip(states, powers, strict=True) if power]
        for powers in exponents.tolist()
    ]
    return ca.vertcat(*(reduce(mul, factors, one) for factors in factors_of_monomials))


def from_gain(game: Game, K: ArrayLike) -> Critic:
    """Return the critic with the policy u = -K z.

    game: the game whose solution the critic approximates
    K: (m, n), or (n,) for one input. The labels of a pandas or polars frame, or of an xarray array,
        are matched with the names of the inputs and states

    Raises BadInputError if K is not a real m x n matrix, or contains a number out of range.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> hfa.verify(game, hfa.from_gain(game, [[0.5]])).ok
    False
    """
    gain = in_order("K", K, game.names.inputs, game.names.states)
    return Critic(game.checked_gain(gain), is_discrete=game.is_discrete)


def from_value(game: Game, P: ArrayLike) -> Critic:
    """Return the critic with the value V = z'Pz and the policy u = -R⁻¹(B'P + N') z.

    In discrete time, the policy is optimal for one step, followed by the cost V.

    game: the game whose solution the critic approximates
    P: (n, n); labels as for K of `from_gain`

    Raises BadInputError if P is not a real n x n matrix, or contains a number out of range.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> hfa.from_value(game, [[3.0]]).K.tolist()
    [[3.0]]
    """
    names = game.names.states
    P = numbers_in("P", in_order("P", P, names, names))
    if P.shape != game.A.shape:
        n = len(game.A)
        raise BadInputError(f"P is {shape_text(P.shape)}; give {n} x {n}, states x states")
    P = checked_matrix("P", P, LARGEST_CRITIC_ENTRY)
    K = game.gain((P + P.T) / 2.0)  # z'Pz depends on this part
    slope_gain = None if game.is_discrete else game.R_inverse_B_transposed
    return Critic(K, P, "P", slope_gain=slope_gain, is_discrete=game.is_discrete)


def from_parts(
    game: Game,
    parts: Mapping[str, np.ndarray],
    basis: Basis | ca.Function | str = "quadratic",
    policy: ca.Function | None = None,
) -> Critic:
    """Return the critic defined by weights W, a value matrix P, a gain K, or several of them.

    - The value is W'ψ(z) if W is given, else z'Pz, and unknown if only K is given.
    - The policy is the given one, or -K z if K is given, otherwise the minimizing policy of the
      value.

    game: the game whose solution the critic approximates
    parts: "W", "P" and "K" -> array, at least one of them
    basis: ψ of W
    policy: CasADi Function z (n,) -> u (m,) of the entry "policy_weights" of a critic file, or None

    Raises BadInputError if a shape or number is wrong, or if W and P define different values.
    """
    K = None
    if "K" in parts:
        K = game.checked_gain(in_order("K", parts["K"], game.names.inputs, game.names.states))
    by_matrix = from_value(game, parts["P"]) if "P" in parts else None
    by_weights = from_weights(game, parts["W"], basis) if "W" in parts else None
    if by_matrix is not None and by_weights is not None and by_weights.P is not None:
        P, sizes = parts["P"], np.sqrt(np.abs(np.diag(parts["P"])))
        if not np.all(np.abs(P - by_weights.P) <= _ROUNDING * np.outer(sizes, sizes)):
            raise BadInputError("W and P define different value functions; leave out W or P")
    critic = by_weights or by_matrix
    if critic is None:
        assert K is not None  # at least one part is given
        critic = Critic(K, is_discrete=game.is_discrete)
    if policy is not None:
        z = ca.SX.sym("z", len(game.A))
        outputs = {"policy": policy(z)}
        if critic.value is not None:
            outputs["V"] = critic.value(z)
        of_outputs = from_functions(game, z, outputs, f"{critic.origin} and policy_weights")
        return replace(of_outputs, weights=critic.weights, basis=critic.basis, has_weights=True)
    if K is None or critic.P is None:  # only a value, or only a gain
        return critic
    functions = dict(critic.network)
    if functions:
        z = ca.SX.sym("z", len(game.A))
        functions["policy"] = ca.Function("policy", [z], [ca.densify(-ca.DM(K) @ z)])
    return replace(  # V of W or P, with the policy -K z
        critic,
        K=K,
        origin=f"{critic.origin} and K",
        slope_gain=None,
        network=functions,
    )


def polynomial_policy(weights: np.ndarray, scales: np.ndarray) -> ca.Function:
    """Return the policy z (n,) -> u (m,), a polynomial without a constant term.

    weights: (m, M), of all monomials of degree 1, 2, ... of the scaled states, with the last index
        fastest
    scales: factors on the states, (n,)

    Raises BadInputError if M is not the number of all monomials up to some degree.
    """
    n = len(scales)
    exponents = np.zeros((0, n), dtype=int)
    degree = 0
    while len(exponents) < weights.shape[1]:
        degree += 1
        exponents = np.vstack([exponents, monomials(n, degree)])
    if len(exponents) != weights.shape[1]:
        raise BadInputError(
            f"policy_weights is {shape_text(weights.shape)}; give a column for each monomial of "
            f"{n} states up to one degree"
        )
    z = ca.SX.sym("z", n)
    u = ca.DM(weights) @ monomials_of(ca.DM(scales) * z, exponents)
    return ca.Function("policy", [z], [ca.densify(u)])


def from_functions(
    game: Game,
    z: ca.SX,
    outputs: Mapping[str, ca.SX],
    origin: str,
    precision: str = "float64",
) -> Critic:
    """Return the critic whose functions are given as expressions of the symbols z.

    K = -∂u/∂z and P = ½ ∂²V/∂z² at z = 0 are means of the derivatives at two opposite states beside
    it. `origin` says so where these differ. If only "policy" is given, P is None.

    game: the game; R, B and N of the game define the policy if "policy" is not in `outputs`
    z: (n,), symbols
    outputs: "V", "gradient" (∂V/∂z), "policy" -> expression, at least one of them
    origin: source of the critic
    precision: floating-point type of the numbers in the critic's file

    Raises BadInputError if a value or a derivative at z = 0 is not finite, and without a policy in
    discrete time.
    """
    V = outputs.get("V")
    u = outputs.get("policy")
    gradient = outputs.get("gradient") if V is None else ca.gradient(V, z)
    expressions = {"V": V, "gradient": gradient, "policy": u}
    network = {
        name: ca.Function(name, [z], [ca.densify(expression)])
        for name, expression in expressions.items()
        if expression is not None
    }
    at_trim = {name: function(np.zeros(z.numel())).full() for name, function in network.items()}
    _refuse_not_finite(at_trim)
    sizes = game.half_widths
    if sizes is None:  # proportional to the states that cost 1, but tiny
        costs = np.diag(game.Q)
        sizes = _SIZE_WITHOUT_BOX * np.where(costs > 0.0, costs, 1.0) ** -0.5
    P, is_nonsmooth = None, False
    if gradient is not None:
        of_V = slope_at_trim(gradient, z, sizes, sizes.max() / sizes, "second derivative of V")
        P, is_nonsmooth = of_V.mean / 2.0, of_V.is_nonsmooth
    if u is None:
        assert P is not None  # V or its gradient is given
        K = game.gain(P)
    else:
        of_u = slope_at_trim(u, z, sizes, np.diag(game.R) ** -0.5, "slope of the policy")
        K, is_nonsmooth = -of_u.mean, of_u.is_nonsmooth
    if is_nonsmooth:
        origin += "; nonsmooth point at the trim: K has the mean slopes of both sides"
    critic = Critic(
        K,
        P,
        origin,
        constant=0.0 if V is None else float(at_trim["V"].item()),
        precision=precision,
        network=network,
        is_discrete=game.is_discrete,
        is_nonsmooth=is_nonsmooth,
    )
    if u is not None:
        return critic
    _refuse_steps(game)  # otherwise, the value implies the policy
    F = game.F if game.N.any() else None
    return replace(critic, slope_gain=game.R_inverse_B_transposed, F=F)


def _refuse_not_finite(at_trim: Mapping[str, np.ndarray]) -> None:
    """Raise BadInputError unless the numbers of a critic at the trim, by name, are finite."""
    for name, numbers in at_trim.items():
        wrong = numbers[~np.isfinite(numbers)]
        if wrong.size:
            raise BadInputError(
                f"the {name} is {wrong[0]:g} at the trim, z = 0; give a critic whose values and "
                "slopes are finite there"
            )


def _refuse_steps(game: Game) -> None:
    """Raise BadInputError for a V that is not quadratic, without a policy, in discrete time."""
    if game.is_discrete:
        raise BadInputError(
            "in discrete time, no policy is computed from a V that is not quadratic; give the "
            "policy, with V or alone"
        )


#: Distances from the trim, in sizes of the states, at which slopes are compared.
_DISTANCES = (1e-9, 1e-12)
#: Least change of the slope between states about a nonsmooth point, relative to the slope, and the
#: least share of it that remains at the smaller distance. Of a smooth function, a thousandth
#: remains, the ratio of the distances.
_LEAST_CHANGE = 1e-3
_LEAST_SHARE = 0.5
#: Size of the states without a box, relative to those that cost 1: the cost's unit says nothing of
#: how near to 0 a nonsmooth point is, and only one exactly at 0 counts.
_SIZE_WITHOUT_BOX = 1e-200


class Slope(NamedTuple):
    """Slope at the trim, (k, n), and whether other slopes were found beside it."""

    mean: np.ndarray
    is_nonsmooth: bool


def slope_at_trim(
    expression: ca.SX, z: ca.SX, sizes: np.ndarray, units: np.ndarray, what: str
) -> Slope:
    """Return the slope of k entries at z = 0: the mean of the derivatives at two opposite states.

    The derivative at 0 itself is CasADi's choice where an activation has a kink. The function is
    nonsmooth if the derivatives at opposite states in n + 1 directions differ, however near these.

    sizes: of the states, (n,)
    units: of the entries, (k,), in which slopes are compared
    what: name of the slope, for the error that it is not finite at 0
    """
    k, n = expression.numel(), z.numel()
    w = type(z).sym("w", k)
    times_w = ca.jtimes(expression, z, w, True)  # (∂expression/∂z)'w
    function = ca.Function("times_w", [z, w], [times_w])

    def slopes_at(states: np.ndarray) -> np.ndarray:
        """Return the derivatives at states (N, n), (N, k, n), from a call for each unit w."""
        rows = function(np.repeat(states, k, axis=0).T, np.tile(np.eye(k), len(states)))
        return np.array(rows).T.reshape(-1, k, n)

    _refuse_not_finite({what: slopes_at(np.zeros((1, n)))})
    # Unequal entries, by multiples of the golden ratio: on no plane where policies switch, such as
    # z1 = 0 or z1 = z2. All further directions differ in the sign of one state.
    directions = (1.0 + np.arange(n) * 0.618 % 1.0) * np.vstack([np.ones(n), 1.0 - 2.0 * np.eye(n)])
    opposite = sizes * np.stack([directions, -directions], axis=1).reshape(-1, n)
    far, near = (slopes_at(distance * opposite) for distance in _DISTANCES)

    def largest(slopes: np.ndarray) -> float:
        return float(np.abs(slopes * (sizes / sizes.max()) / units[:, None]).max(initial=0.0))

    with np.errstate(all="ignore"):
        change, near_change = largest(far - far[0]), largest(near - near[0])
        # Of a smooth function, the change is proportional to the distance.
        is_large = _LEAST_CHANGE * largest(far) < change < math.inf
    mean = (near[0] + near[1]) / 2.0
    _refuse_not_finite({what: mean})
    return Slope(mean, is_large and near_change > _LEAST_SHARE * change)


def from_weights(
    game: Game,
    weights: ArrayLike,
    basis: Basis | str | list[str] | ca.Function = "quadratic",
    constant: float = 0.0,
    precision: str = "float64",
) -> Critic:
    """Return the critic V = W'ψ(z) + constant, u = -½ R⁻¹B' (∂ψ/∂z)'W (paper Eq. 28).

    With cross weights N, u = -½ R⁻¹B' (∂ψ/∂z)'W - R⁻¹N'z. In discrete time, V must be quadratic,
    and the policy is optimal for one step, followed by the cost V.

    game: the game whose solution the critic approximates
    weights: W, (M,), also as a row or a column
    basis: the name of a basis, functions "x1**2, x1*x2" or ["x1**2", "x1*x2"], a basis, or a
        CasADi Function z (n,) -> ψ(z) (M,)
    constant: constant term of V, which is V(0) if ψ(0) = 0
    precision: floating-point type of the numbers in the critic's file

    Raises BadInputError if W does not consist of M finite numbers, if the name of the basis is
    unknown, if the input of a CasADi Function is not a vector of n entries, or if the constant is
    not a finite number.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> hfa.from_weights(game, [3.0]).K.tolist()
    [[3.0]]
    """
    weights = checked_matrix("W", weights, LARGEST_CRITIC_ENTRY, None)
    if max(weights.shape, default=0) == weights.size:  # a row or a column
        weights = weights.reshape(-1)
    n = len(game.A)
    if not is_finite(constant):
        raise BadInputError(f"constant is {shown(constant)}; give a finite number, V(0)")
    psi = basis_of(basis, n, game.names.states)
    if isinstance(psi, ca.Function):
        return _from_listed_functions(game, weights, psi, constant, precision)
    if weights.shape != (psi.size,):
        names = " or ".join(bases_of_size(weights.size, n))
        instead = f"{psi.size} weights, P or a list of functions as the basis"
        raise BadInputError(
            f"W has {weights.size} weights, but basis {psi.name!r} of {n} states has {psi.size} "
            f"functions; give {f'the basis {names}' if names else instead}"
        )
    critic = replace(
        from_value(game, psi.matrix(weights)),
        origin="weights",
        weights=weights,
        basis=psi,
        constant=constant,
        precision=precision,
        has_weights=True,
    )
    if not critic.is_quadratic:
        _refuse_steps(game)
    return critic


def _from_listed_functions(
    game: Game, weights: np.ndarray, psi: ca.Function, constant: float, precision: str
) -> Critic:
    """Return the critic V = W'ψ(z) + constant of a CasADi Function ψ; W (M,)."""
    n = len(game.A)
    if psi.numel_in(0) != n or weights.shape != (psi.numel_out(0),):
        raise BadInputError(
            f"W has {weights.size} weights and the plant has {n} states; give a basis of "
            f"{weights.size} functions of {n} states"
        )
    z = ca.SX.sym("z", n)
    V = ca.DM(weights).T @ ca.vec(psi(z)) + constant
    critic = from_functions(game, z, {"V": V}, "weights of a list of functions", precision)
    return replace(critic, has_weights=True)


def from_q_function(
    game: Game, H: ArrayLike, parts: Mapping[str, np.ndarray] | None = None
) -> Critic:
    """Return the critic of a Q-function Q(x, u, w) = [x; u; w]'H [x; u; w] in discrete time.

    P, K and L are those at the extremum of Q over u and w (`q_extremum`).

    game: the game whose solution the critic approximates
    H: symmetric matrix over (x, u, w) or (x, u)
    parts: P, K or L that were stored with H, in place of those that H implies

    Raises BadInputError if a matrix has a wrong shape, or H has no extremum.
    """
    H = numbers_in("H", H)
    matrices = q_extremum(game, H) | dict(parts or {})
    critic = from_parts(game, {name: matrices[name] for name in ("P", "K")})
    return replace(critic, H=H, L=matrices.get("L"))
