"""Critics defined by weights of functions of the state."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.basis import Basis, basis as named_basis
from controller.game.zero_sum import Game
from hfa_support.arguments import ArrayLike, checks_arguments, need
from hfa_support.errors import BadInputError, is_finite, numbers_in, shown

#: Largest relative difference between W and P of one critic: the rounding of six printed digits.
_TOGETHER = 1e-6


@checks_arguments
def from_weights(
    game: Game,
    weights: ArrayLike,
    basis: Basis | str | ca.Function = "quadratic",
    constant: float = 0.0,
    precision: str = "float64",
) -> Critic:
    """Return the critic V = W'ψ(z) + constant, u = -½ R⁻¹B' (∂ψ/∂z)'W (paper Eq. 28).

    With cross weights N, u = -½ R⁻¹B' (∂ψ/∂z)'W - R⁻¹N'z.

    game: the game whose solution the critic approximates
    weights: W, (M,)
    basis: a basis, its name, or a CasADi Function z (n,) -> ψ(z) (M,)
    constant: constant term of V, which is V(0) if ψ(0) = 0
    precision: floating-point type of the numbers in the critic's file

    Raises BadInputError if W does not consist of M real numbers, if the name of the basis is
    unknown, if the input of a CasADi Function is not a vector of n entries, or if the constant is
    not a finite number.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], delta=2.0)
    >>> hfa.from_weights(game, [3.0]).K.tolist()
    [[3.0]]
    """
    need(game, Game, "from_weights: game", Game.how_to_make)
    weights = numbers_in("W", weights)
    n = len(game.A)
    if not is_finite(constant):
        raise BadInputError(f"constant is {shown(constant)}; give a finite number, V(0)")
    if isinstance(basis, ca.Function):
        count = basis.numel_out(0)
        if basis.numel_in(0) != n or weights.shape != (count,):
            raise BadInputError(
                f"W has {weights.size} weights and the plant has {n} states; give a basis of "
                f"{weights.size} functions of {n} states"
            )
        from controller.critic.expressions import from_functions

        z = ca.SX.sym("z", n)
        V = ca.DM(weights).T @ ca.vec(basis(z)) + constant
        return from_functions(game, z, {"V": V}, "weights of a list of functions", precision)
    psi = named_basis(basis, n) if isinstance(basis, str) else basis
    if weights.shape != (psi.size,):
        raise BadInputError(
            f"W has {weights.size} weights, but basis {psi.name!r} of {psi.states} states has "
            f"{psi.size} functions; give the name of the basis of W"
        )
    P = psi.matrix(weights)
    return Critic(
        game.gain(P),
        P,
        "weights",
        weights=weights,
        basis=psi,
        constant=constant,
        precision=precision,
        feedback=game.R_inverse_B_transposed,
    )


def refuse_different_values(P: np.ndarray, P_of_weights: np.ndarray) -> None:
    """Raise BadInputError if a given matrix P differs from the quadratic part of W'ψ(z).

    The largest permitted difference of entry ij is `_TOGETHER` times sqrt(|P_ii P_jj|).

    P: (n, n), given with W
    P_of_weights: (n, n), the quadratic part of W'ψ(z)
    """
    sizes = np.sqrt(np.abs(np.diag(P)))
    if not np.all(np.abs(P - P_of_weights) <= _TOGETHER * np.outer(sizes, sizes)):
        raise BadInputError("W and P define different value functions; leave out W or P")
