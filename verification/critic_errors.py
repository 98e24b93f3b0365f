"""Errors of a critic: in norms, entry by entry, and in a box of states.

V - V* is a polynomial with the coefficients c = W - W*. In the coordinates y_i = z_i / b_i, with b
the half-widths of the box, V - V* is Σ_m c_m ψ_m(b) ψ_m(y), and |ψ_m(y)| <= 1. Therefore the sum of
|c_m ψ_m(b)| bounds the error at every state in the box. Derivatives are bounded in the same way.

The scale of a linear problem is arbitrary. Therefore each bound is valid for every box λb with
1/`REACH` <= λ <= `REACH`. A term of degree p counts λ^(p-2) times as much as the quadratic V*.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY
from controller.riccati.gare import Solution
from hfa_support.errors import BadInputError, numbers_in
from hfa_support.matrices import checked_matrix, shape_text
from hfa_support.reporting.report import Check, at_most
from hfa_support.reporting.text import percent
from verification.box import balanced_units

#: Default limit of the errors of P, K, V, its gradient and the policies, and of the residual.
LIMIT = 1e-6
#: Errors are bounded in all boxes from 1 / `REACH` to `REACH` times the given one.
REACH = 10.0
#: The error of an entry below this fraction of the largest is relative to this fraction.
SMALL = 1e-5


def relative_error(value: np.ndarray, exact: np.ndarray) -> float:
    """Return the relative error |value - exact| / |exact| in Frobenius norms.

    The result is inf if a number of `value` is not finite, or if exact is 0 and value is not.
    Raises BadInputError for different shapes.

    >>> import numpy as np
    >>> from verification import relative_error
    >>> relative_error(np.array([3.0, 4.5]), np.array([3.0, 4.0]))
    0.1
    """
    value, exact = numbers_in("value", value), numbers_in("exact", exact)
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


def floored(sizes: np.ndarray) -> np.ndarray:
    """Return sizes of at least `SMALL` times the largest one, or 1 if all are 0."""
    return np.maximum(sizes, SMALL * sizes.max()) if sizes.any() else np.ones(sizes.shape)


def error_check(name: str, error: float, limit: float, what: str) -> Check:
    """Return the check that an error is at most a limit.

    name: name of the check
    error: the error
    limit: the limit
    what: quantity with the error, for the reason of a failure: "K" gives "K is off by 10 %"
    """
    size = percent(100.0 * error, up=True)
    return at_most(name, error, limit, f"{what} is off by {size}", kind="error")


def critic_errors(critic: Critic, exact: Solution, limit: float, box: np.ndarray) -> list[Check]:
    """Return the checks of a critic's errors: of K, of P if known, of V and the policy in a box,
    and of the worst disturbance; in discrete time, of the Q-function in its place.

    The errors in the box are omitted for a critic with a network: they are searched for.

    exact: solution of the game
    limit: limit of each error
    box: half-widths of the box of states, (n,)
    """
    checks = matrix_errors("K", critic.K, exact, limit)
    if not critic.network:
        checks += box_errors(critic, exact, limit, box)
    if critic.P is not None:
        checks += matrix_errors("P", critic.P, exact, limit)
    if exact.game.is_discrete:
        return checks + q_function_errors(critic, exact, limit)
    return checks + disturbance_errors(critic, exact, limit, box)


def matrix_errors(name: str, matrix: np.ndarray, solution: Solution, limit: float) -> list[Check]:
    """Return three checks of the errors of a matrix P or K.

    With the balanced units U, the checks are those of
    - the relative error of the matrix in the units of the game, in the Frobenius norm,
    - the relative error of U P U or R^(1/2) K U, in the Frobenius norm,
    - the largest relative error of an entry of U P U or diag(R)^(1/2) K U.

    In discrete time, R is the weight R + α B'P B.

    name: "P" or "K"
    matrix: P, (n, n), or K, (m, n), of the critic
    solution: the exact solution
    limit: limit of each error
    """
    norm, balanced, entry = measure_of(name, solution).errors(matrix)
    return [
        error_check(f"{name}_rel_error", norm, limit, name),
        error_check(f"{name}_balanced_error", balanced, limit, f"{name} in balanced units"),
        error_check(f"{name}_entry_error", entry, limit, f"an entry of {name}"),
    ]


def is_gain_right(K: np.ndarray, exact: Solution, limit: float) -> bool:
    """Return whether K passes the checks of `matrix_errors`, which no unit of an input decides."""
    return all(check.ok for check in matrix_errors("K", K, exact, limit))


class Measure(NamedTuple):
    """What the errors of a matrix M, P or K, are measured by.

    exact: the exact matrix
    root, scales: root M * scales is M in balanced units
    entry_scales: M * entry_scales has entries that do not depend on units
    largest: in place of that of an exact matrix of zeros in balanced units
    """

    exact: np.ndarray
    root: np.ndarray
    scales: np.ndarray
    entry_scales: np.ndarray
    largest: float

    def errors(self, matrix: np.ndarray) -> tuple[float, float, float]:
        """Return the errors of a matrix in norm, in balanced units and of an entry."""
        exact, root, scales, entry_scales, largest = self
        if largest and not exact.any():
            error = float(np.abs(root @ matrix * scales).max()) / largest
            return error, error, error
        return (
            relative_error(matrix, exact),
            relative_error(root @ matrix * scales, root @ exact * scales),
            entry_error((matrix - exact) * entry_scales, exact * entry_scales),
        )


def measure_of(name: str, solution: Solution) -> Measure:
    """Return the measure of P, by U P U, or of K, by R^(1/2) K U and diag(R)^(1/2) K U.

    name: "P" or "K"
    """
    units = balanced_units(solution.game)
    if name == "P":
        scales = np.outer(units, units)
        return Measure(solution.P, np.eye(len(units)), scales, entry_scales=scales, largest=0.0)
    weight = solution.suboptimality_weight  # R, in discrete time R + α B'P B
    eigenvalues, vectors = np.linalg.eigh(weight)
    root = np.sqrt(np.abs(eigenvalues))[:, None] * vectors.T  # root' root is the weight
    entry_scales = np.sqrt(np.diag(weight))[:, None] * units
    # A K with this size costs as much in one second, or step, as the state.
    largest = float((np.sqrt(np.abs(np.diag(solution.P))) * units).max())
    return Measure(solution.K, root, units, entry_scales, largest)


def box_errors(critic: Critic, exact: Solution, limit: float, box: np.ndarray) -> list[Check]:
    """Return the checks of a critic's errors in a box: of V, each ∂V/∂z_i, and each entry of u.

    The errors are upper bounds. The error of V is relative to the sum of the magnitudes of the
    terms of the exact value at the corner of the box, and all other errors to the largest exact
    value in the box. Without P, only the policy is checked.

    box: (n,), half-widths
    """
    higher = higher_terms(critic, box)
    with np.errstate(all="ignore"):  # a number that is not finite fails the check
        u_errors = np.abs(critic.K - exact.K) @ box
        if critic.slope_gain is not None:  # u = -½ R⁻¹B' ∂V/∂z also has the higher terms of V
            # Divided by b_i, the bounds of b_i ∂V/∂z_i are those of the slopes.
            u_errors += 0.5 * np.abs(critic.slope_gain) @ (higher.slopes / box)
    u_scale = np.sqrt(np.diag(exact.suboptimality_weight))  # makes inputs comparable
    u_sizes = u_scale * (np.abs(exact.K) @ box)
    if not u_sizes.any():  # the exact policy is 0: errors are relative to the cost of the state
        u_sizes += math.sqrt(np.abs(np.diag(exact.P)) @ box**2)
    policy = entry_error(u_scale * u_errors, u_sizes)
    checks = [error_check("policy_rel_error", policy, limit, "the policy in the box")]
    if critic.P is None:
        return checks
    corner = np.outer(box, box)
    with np.errstate(all="ignore"):
        V_errors = np.abs((critic.P + critic.P.T) / 2.0 - exact.P) * corner
        V_sizes = np.abs(exact.P) * corner
    value = entry_error(np.atleast_1d(V_errors.sum() + higher.value), np.atleast_1d(V_sizes.sum()))
    checks.append(error_check("value_rel_error", value, limit, "V in the box"))
    slopes = entry_error(2.0 * V_errors.sum(axis=1) + higher.slopes, 2.0 * V_sizes.sum(axis=1))
    checks.append(error_check("gradient_rel_error", slopes, limit, "a slope of V in the box"))
    return checks


def disturbance_errors(
    critic: Critic, exact: Solution, limit: float, box: np.ndarray
) -> list[Check]:
    """Return the check of d = ½ δ⁻²E'∂V/∂z, the worst disturbance in continuous time, in a box.

    The result is empty without P, for a critic with a network, and without a disturbance.

    box: (n,), half-widths
    """
    game = exact.game
    has_disturbance = math.isfinite(game.delta) and game.E.size
    if critic.P is None or critic.network or not has_disturbance:
        return []
    higher = higher_terms(critic, box)
    with np.errstate(all="ignore"):
        errors = np.abs(game.disturbance_gain((critic.P + critic.P.T) / 2.0 - exact.P)) @ box
        # Divided by b_i, the bounds of b_i ∂V/∂z_i are those of the slopes.
        errors += 0.5 * np.abs(game.E.T) @ (higher.slopes / box) / game.delta**2
    worst = entry_error(errors, np.abs(exact.disturbance_gain) @ box)
    return [error_check("disturbance_rel_error", worst, limit, "the worst disturbance in the box")]


def q_function_errors(critic: Critic, exact: Solution, limit: float) -> list[Check]:
    """Return the checks of the matrices L and H of a critic in discrete time, as far as given.

    The error of L is relative to |L|. The error of an entry H_ij is relative to √(H_ii H_jj). An H
    over (x, u) is compared with the exact H for the worst w.

    Raises BadInputError if L has a wrong shape.
    """
    checks = []
    if critic.L is not None:
        exact_L = exact.disturbance_gain
        L = checked_matrix("L", critic.L, LARGEST_CRITIC_ENTRY)
        if L.shape != exact_L.shape:
            raise BadInputError(
                f"L is {shape_text(L.shape)}; give {shape_text(exact_L.shape)} for this plant"
            )
        checks.append(error_check("L_rel_error", relative_error(L, exact_L), limit, "L"))
    exact_H = exact_action_value(critic, exact)
    if critic.H is not None and exact_H is not None:
        error = action_value_error(critic.H, exact_H)
        checks.append(error_check("H_entry_error", error, limit, "an entry of H"))
    return checks


def action_value_error(H: np.ndarray, exact: np.ndarray) -> float:
    """Return the largest error of an entry H_ij, relative to √(H_ii H_jj) of the exact H."""
    sizes = np.sqrt(np.abs(np.diag(exact)))
    return float(np.max(np.abs(H - exact) / np.outer(sizes, sizes)))


def exact_action_value(critic: Critic, exact: Solution) -> np.ndarray | None:
    """Return the exact matrix H of the Q-function over the signals of a critic's H, or None if the
    critic has no H.

    The signals are (x, u, w), or (x, u) for the worst w: the Schur complement of the block of w.
    """
    exact_H = exact.H
    if critic.H is None or exact_H is None:
        return None
    size = len(critic.H)
    if size == len(exact_H):
        return exact_H
    crossed = exact_H[:size, size:]
    by_worst_w = crossed @ np.linalg.solve(exact_H[size:, size:], crossed.T)
    return np.asarray(exact_H[:size, :size] - by_worst_w)


class HigherTerms(NamedTuple):
    """Bounds of the terms of V that are not quadratic.

    Divided by λ², the terms in each box λb with 1/`REACH` <= λ <= `REACH` are within the bounds.

    value: of V
    slopes: of b_i ∂V/∂z_i, with the half-widths b, (n,)
    """

    value: float
    slopes: np.ndarray


def higher_terms(critic: Critic, box: np.ndarray) -> HigherTerms:
    """Return bounds of the terms of a critic's V that are not quadratic, in all boxes λb.

    box: half-widths b, (n,)
    """
    psi = critic.basis
    if critic.weights is None or psi is None or psi.size == psi.quadratic_size:
        return HigherTerms(0.0, np.zeros(len(box)))
    exponents = psi.exponents[psi.quadratic_size :]  # of the terms that are not quadratic
    sizes = np.abs(critic.weights[psi.quadratic_size :])
    with np.errstate(all="ignore"):
        reach = REACH ** np.abs(exponents.sum(axis=1) - 2)  # largest λ^(degree - 2)
        terms = sizes * np.prod(box**exponents, axis=1) * reach
    # b_i times the derivative of a monomial by z_i is its exponent of z_i times the monomial.
    return HigherTerms(float(terms.sum()), terms @ exponents)


def equilibrium_check(
    equilibrium: np.ndarray | None, P: np.ndarray, b: np.ndarray, limit: float
) -> Check:
    """Return the check of V* at the equilibrium, in percent of its mean over the corners of the
    box, tr(b P b).

    V* is the cost of steering from the equilibrium to the trim. It is quadratic in the distance: an
    equilibrium at 0.1 of the box costs about 1 %.

    equilibrium: equilibrium, (n,), or None if none was found; the cost is then infinite
    P: matrix of V*, (n, n)
    b: half-widths of the box of states, (n,)
    limit: largest distance that passes, relative to the box
    """
    share, reason = math.inf, "no equilibrium near trim"
    if equilibrium is not None:
        cost = float(equilibrium @ P @ equilibrium)
        share = 100.0 * cost / float(np.diag(P) @ b**2) if cost > 0.0 else 0.0
        distance = float((np.abs(equilibrium) / b).max())
        reason = f"equilibrium {distance:.2g} boxes off trim, V* there {percent(share, up=True)}"
    return at_most("rest_point", share, 100.0 * limit**2, reason, kind="rest")
