"""Errors of a critic: in norms, entry by entry, and in a box of states.

V - V* is a polynomial with the coefficients c = W - W*. In the coordinates y_i = z_i / b_i, with b
the half-widths of the box, V - V* is Σ_m c_m ψ_m(b) ψ_m(y), and |ψ_m(y)| <= 1. Therefore the sum of
|c_m ψ_m(b)| bounds the error at every state in the box. Derivatives are bounded in the same way.

The scale of a linear problem is arbitrary. Therefore each bound is valid for every box λb with
1/`REACH` <= λ <= `REACH`. A term of degree p counts λ^(p-2) times as much as the quadratic V*.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.riccati.normal_form import NormalForm
from hfa_aircraft.names import PlantNames
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError
from hfa_support.reporting.checks import Check, at_most
from hfa_support.reporting.results import Matrix, Vector

REACH = 10.0
#: The error of an entry below this fraction of the largest is relative to this fraction.
SMALL = 1e-5


class Exact(Protocol):
    """Exact solution of a game: value z'Pz and policies u = -K z, d = L z."""

    @property
    def P(self) -> Matrix:
        """Matrix P of the value z'Pz, (n, n)."""

    @property
    def K(self) -> Matrix:
        """Gain K of the policy u = -K z, (m, n)."""

    @property
    def disturbance_gain(self) -> np.ndarray:
        """Gain L of the worst disturbance d = L z, (k, n)."""

    @property
    def names(self) -> PlantNames:
        """Names and units of the game's states and inputs."""


class Box(NamedTuple):
    """Box |z_i| <= half_widths[i] of states in which V, its gradient and the policies are compared.

    half_widths: (n,), in the units of the states
    about: source of the half-widths, as text
    """

    half_widths: Vector
    about: str


def balanced_box(game: Game) -> Box:
    """Return the default box of states, with the balanced units of the game as half-widths."""
    about = "balanced units of the game (a convention, because no typical deviations are given)"
    return Box(NormalForm.of(game).units, about)


def limited_box(half_widths: np.ndarray) -> Box:
    """Return the box with these half-widths, the largest within the limits of the states."""
    return Box(half_widths, "within the limits of the states that the model declares")


@checks_arguments
def relative_error(value: np.ndarray, exact: np.ndarray) -> float:
    """Return the relative error |value - exact| / |exact| in Frobenius norms.

    The result is inf if a number of `value` is not finite, or if exact is 0 and value is not.
    Raises BadInputError for different shapes.

    >>> import numpy as np
    >>> from verification import relative_error
    >>> relative_error(np.array([3.0, 4.5]), np.array([3.0, 4.0]))
    0.1
    """
    value = np.asarray(value, dtype=float)
    exact = np.asarray(exact, dtype=float)
    if value.shape != exact.shape:
        raise BadInputError(
            f"the value has shape {value.shape}, the exact value {exact.shape}; give equal shapes"
        )
    if not np.all(np.isfinite(value)):
        return math.inf
    with np.errstate(over="ignore"):  # overflow: the error is inf
        difference = float(np.linalg.norm(value - exact))
        size = float(np.linalg.norm(exact))
    if size == 0.0:
        return 0.0 if difference == 0.0 else math.inf
    return difference / size


def entry_error(difference: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest relative error of an entry.

    The error of an entry is |difference_ij| / max(|exact_ij|, `SMALL` max |exact|). The result is
    inf if a difference is not finite, or if exact is 0 and a difference is not.

    difference: error of each entry, an array of any shape
    exact: the exact entries, in the same shape
    """
    largest = float(np.abs(exact).max(initial=0.0))
    if not np.all(np.isfinite(difference)):
        return math.inf
    if largest == 0.0:
        return math.inf if np.any(difference) else 0.0
    return float((np.abs(difference) / np.maximum(np.abs(exact), SMALL * largest)).max())


def error_check(name: str, error: float, limit: float, what: str) -> Check:
    """Return the check that an error is at most a limit.

    name: name of the check
    error: the error
    limit: the limit
    what: quantity with the error, for the reason of a failure: "K" gives "K is off by 0.1"
    """
    return at_most(name, error, limit, f"{what} is off by {error:.2g}", kind="error")


def critic_errors(
    game: Game, critic: Critic, exact: Exact, limit: float, box: Box | None = None
) -> tuple[Check, ...]:
    """Return the checks of a critic's errors: of K, of P if known, and of V and the policies in a
    box.

    The errors in the box are omitted for a critic with a network.

    exact: solution of the game
    limit: limit of each error
    box: box of states, by default `balanced_box`
    """
    checks = list(matrix_errors(game, "K", critic.K, exact.K, limit))
    if not critic.network:
        half_widths = (box or balanced_box(game)).half_widths
        checks += box_errors(game, critic, exact, half_widths, limit)
    if critic.P is not None:
        checks += matrix_errors(game, "P", critic.P, exact.P, limit)
    return tuple(checks)


def matrix_errors(
    game: Game, name: str, matrix: np.ndarray, exact: np.ndarray, limit: float
) -> tuple[Check, ...]:
    """Return three checks of the errors of a matrix P or K.

    With the balanced units U, the checks are those of
    - the relative error of the matrix in the units of the game, in the Frobenius norm,
    - the relative error of U P U or R^(1/2) K U, in the Frobenius norm,
    - the largest relative error of an entry of U P U or diag(R)^(1/2) K U.

    name: "P" or "K"
    matrix: P, (n, n), or K, (m, n), of the critic
    exact: the exact matrix
    limit: limit of each error
    """
    units = NormalForm.of(game).units
    if name == "P":
        scales = np.outer(units, units)
        entry_scales = scales
        root = np.eye(len(matrix))
    else:
        eigenvalues, vectors = np.linalg.eigh(game.R)
        root = np.sqrt(np.abs(eigenvalues))[:, None] * vectors.T
        scales = np.outer(np.ones(len(matrix)), units)
        entry_scales = np.sqrt(np.diag(game.R))[:, None] * scales
    norm = relative_error(matrix, exact)
    balanced = relative_error(root @ matrix * scales, root @ exact * scales)
    entry = entry_error((matrix - exact) * entry_scales, exact * entry_scales)
    return (
        error_check(f"{name}_rel_error", norm, limit, name),
        error_check(f"{name}_balanced_error", balanced, limit, f"{name} in balanced units"),
        error_check(f"{name}_entry_error", entry, limit, f"an entry of {name}"),
    )


def box_errors(
    game: Game, critic: Critic, exact: Exact, box: np.ndarray, limit: float
) -> tuple[Check, ...]:
    """Return the checks of a critic's errors in a box: of V, each ∂V/∂z_i, and each entry of u and
    d.

    The errors are upper bounds. The error of V is relative to the sum of the magnitudes of the
    terms of the exact value at the corner of the box, and all other errors to the largest exact
    value in the box. u is the critic's policy, and d = ½ δ⁻²E'∂V/∂z is the worst disturbance.
    Without P, only the policy is checked. With δ = inf, d is not checked.

    exact: solution of the game
    box: (n,), half-widths
    limit: limit of each error
    """
    corner = np.outer(box, box)
    P = exact.P if critic.P is None else (critic.P + critic.P.T) / 2.0  # z'Pz depends on this part
    K = critic.K if critic.feedback is None else game.gain(P)
    higher_value, higher_slopes = _higher_terms(critic, box)
    with np.errstate(all="ignore"):  # a number that is not finite fails the check
        V_errors = np.abs(P - exact.P) * corner
        V_sizes = np.abs(exact.P) * corner
        u_errors = np.abs(K - exact.K) @ box
        if critic.feedback is not None:
            u_errors += 0.5 * np.abs(game.R_inverse_B_transposed) @ (higher_slopes / box)
        d_errors = np.abs(game.disturbance_gain(P - exact.P)) @ box
        d_errors += 0.5 * np.abs(game.E.T) @ (higher_slopes / box) / game.delta**2
    u_scale = np.sqrt(np.diag(game.R))
    policy = entry_error(u_scale * u_errors, u_scale * (np.abs(exact.K) @ box))
    checks = [error_check("policy_rel_error", policy, limit, "the policy in the box")]
    if critic.P is None:
        return tuple(checks)
    value = entry_error(np.atleast_1d(V_errors.sum() + higher_value), np.atleast_1d(V_sizes.sum()))
    checks.append(error_check("value_rel_error", value, limit, "V in the box"))
    slopes = entry_error(2.0 * V_errors.sum(axis=1) + higher_slopes, 2.0 * V_sizes.sum(axis=1))
    checks.append(error_check("gradient_rel_error", slopes, limit, "a slope of V in the box"))
    if math.isfinite(game.delta) and game.E.size:
        worst = entry_error(d_errors, np.abs(exact.disturbance_gain) @ box)
        what = "the worst disturbance in the box"
        checks.append(error_check("disturbance_rel_error", worst, limit, what))
    return tuple(checks)


def _higher_terms(critic: Critic, box: np.ndarray) -> tuple[float, np.ndarray]:
    """Return bounds of the terms of V that are not quadratic, and of their gradient (n,).

    Divided by λ², the terms in each box λb with 1/`REACH` <= λ <= `REACH` are within the bounds.
    The bounds of the gradient are multiplied by the half-widths b_i.

    box: b, (n,)
    """
    psi = critic.basis
    if critic.weights is None or psi is None or psi.size == psi.quadratic_size:
        return 0.0, np.zeros(len(box))
    exponents = psi.exponents[psi.quadratic_size :]
    sizes = np.abs(critic.weights[psi.quadratic_size :])
    with np.errstate(all="ignore"):
        reach = REACH ** np.abs(exponents.sum(axis=1) - 2)
        terms = sizes * np.prod(box**exponents, axis=1) * reach
    return float(terms.sum()), terms @ exponents
