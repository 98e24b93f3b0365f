"""How far a critic is from the exact one: in norms, entry by entry, and over a whole box of states.

V - V* = Σ_m c_m ψ_m(z), c = W - W*. In y_i = z_i / b_i, b the half widths of the box, it is Σ_m c_m
ψ_m(b) ψ_m(y) with |ψ_m(y)| <= 1: the sum of |c_m ψ_m(b)| bounds the error at every state of the
box, and so for the derivatives. No polynomial hides between samples. The scale of a linear problem
is arbitrary, so each bound holds for every box λb with 1/`REACH` <= λ <= `REACH`: a term of degree
p counts λ^(p-2) times as much as the quadratic V*."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.hfa_game import ORDINARY_DEVIATIONS
from controller.riccati.balancing import balanced_units
from controller.riccati.gare import Solution
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATE_UNITS
from hfa_support.reporting.checks import Check, at_most
from hfa_support.reporting.unit_system import in_force, si_factor, si_unit, unit_in_force

#: States and inputs of the aircraft's linear model.
AIRCRAFT_SHAPE = (6, 5)
_UNITS = tuple(getattr(STATE_UNITS, name) for name in LINEAR_STATES)
REACH = 10.0
#: An entry below this part of the largest is compared with that part.
SMALL = 1e-5


class Box(NamedTuple):
    """half_widths: (n,), in the units of the states. about: where they come from."""

    half_widths: np.ndarray
    about: str

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return self._asdict()


def ordinary_box(
    game: Game,
    states: tuple[str, ...] = (),
    inputs: tuple[str, ...] = (),
    state_units: tuple[str, ...] = (),
) -> Box:
    """`ORDINARY_DEVIATIONS` where states, inputs and units (English or SI) are the aircraft's, else
    balanced units.

    A game without names is taken for the aircraft's where it has its six states and five inputs.
    """
    named = (
        (states, inputs) == (LINEAR_STATES, INPUTS) if states else game.B.shape == AIRCRAFT_SHAPE
    )
    si = tuple(map(si_unit, _UNITS))
    if not named or (any(state_units) and state_units not in (_UNITS, si)):
        return Box(
            balanced_units(game),
            "balanced units of the game; a convention, the plant has not the aircraft's names",
        )
    in_si = state_units == si
    widths = np.array(ORDINARY_DEVIATIONS) * [si_factor(unit) if in_si else 1.0 for unit in _UNITS]
    speed = (
        f"{widths[0]:g} {si[0]}"
        if in_si
        else f"{in_force(widths[0], 'ft/s'):g} {unit_in_force('ft/s')}"
    )
    return Box(widths, f"ordinary deviations of the aircraft, {speed}, 0.1 rad, 0.1 rad/s")


def relative_error(value: np.ndarray, exact: np.ndarray) -> float:
    """|value - exact| / |exact|, Frobenius norms; inf when a number is not finite, or |exact| alone
    is 0."""
    if not np.all(np.isfinite(value)):
        return math.inf
    with np.errstate(over="ignore"):  # then the error is inf
        difference, size = float(np.linalg.norm(value - exact)), float(np.linalg.norm(exact))
    if size == 0.0:
        return 0.0 if difference == 0.0 else math.inf
    return difference / size


def entry_error(difference: np.ndarray, exact: np.ndarray) -> float:
    """max |difference_ij| / max(|exact_ij|, `SMALL` max |exact|); inf when a number is not
    finite."""
    largest = float(np.abs(exact).max(initial=0.0))
    if not np.all(np.isfinite(difference)):
        return math.inf
    if largest == 0.0:
        return math.inf if np.any(difference) else 0.0
    return float((np.abs(difference) / np.maximum(np.abs(exact), SMALL * largest)).max())


def critic_errors(
    game: Game, critic: Critic, exact: Solution, limit: float, box: Box | None = None
) -> tuple[Check, ...]:
    """Every error of a critic: of K, of P where it has one, and over the box (default
    `ordinary_box`) but of a network."""
    checks = list(matrix_errors(game, "K", critic.K, exact.K, limit))
    if not critic.network:
        half_widths = (box or ordinary_box(game)).half_widths
        checks += box_errors(game, critic, exact, half_widths, limit)
    if critic.P is not None:
        checks += matrix_errors(game, "P", critic.P, exact.P, limit)
    return tuple(checks)


def matrix_errors(
    game: Game, name: str, matrix: np.ndarray, exact: np.ndarray, limit: float
) -> tuple[Check, ...]:
    """Errors of "P" (n, n) or "K" (m, n): unscaled; as U P U or R^(1/2) K U, U = `balanced_units`;
    entry by entry as U P U or diag(R)^(1/2) K U."""
    units, R = balanced_units(game), game.R
    scales, root = np.outer(units, units), np.eye(len(matrix))
    if name == "K":
        eigenvalues, vectors = np.linalg.eigh(R)
        scales, root = (
            np.outer(np.ones(len(R)), units),
            np.sqrt(np.abs(eigenvalues))[:, None] * vectors.T,
        )
    size = np.sqrt(np.diag(R))[:, None] * scales if name == "K" else scales
    errors = {
        "rel": (relative_error(matrix, exact), f"{name} is off by {{:.2g}}"),
        "balanced": (
            relative_error(root @ matrix * scales, root @ exact * scales),
            f"{name} is off by {{:.2g}} in balanced units",
        ),
        "entry": (
            entry_error((matrix - exact) * size, exact * size),
            f"an entry of {name} is off by {{:.2g}}",
        ),
    }
    return tuple(
        at_most(f"{name}_{kind}_error", error, limit, said.format(error))
        for kind, (error, said) in errors.items()
    )


def box_errors(
    game: Game, critic: Critic, exact: Solution, box: np.ndarray, limit: float
) -> tuple[Check, ...]:
    """Bounds over the box, box: (n,), of the errors of V, of each ∂V/∂z_i, and of each entry of u
    and d.

    V relative to the sum of its terms at the corner of the box, the others to their largest value
    in the box. u = -½ R⁻¹B'∂V/∂z as it would be flown, or -K z of a gain; d = ½ δ⁻²E'∂V/∂z, the
    worst disturbance."""
    corner = np.outer(box, box)
    P = exact.P if critic.P is None else (critic.P + critic.P.T) / 2.0  # alone z'Pz depends on it
    K = critic.K if critic.feedback is None else game.gain(P)
    higher_value, higher_slopes = _higher_terms(critic, box)
    with np.errstate(all="ignore"):  # what is not finite fails
        V_errors = np.abs(P - exact.P) * corner
        V_sizes = np.abs(exact.P) * corner
        u_errors = np.abs(K - exact.K) @ box
        if critic.feedback is not None:
            u_errors += 0.5 * np.abs(game.R_inverse_B_transposed) @ (higher_slopes / box)
        d_errors = np.abs(game.disturbance_gain(P - exact.P)) @ box
        d_errors += 0.5 * np.abs(game.E.T) @ (higher_slopes / box) / game.delta**2
    u_scale = np.sqrt(np.diag(game.R))
    error = entry_error(u_scale * u_errors, u_scale * (np.abs(exact.K) @ box))
    reason = f"the policy is off by {error:.2g} of an input's largest in the box"
    checks = [at_most("policy_rel_error", error, limit, reason)]
    if critic.P is None:
        return tuple(checks)
    error = entry_error(np.atleast_1d(V_errors.sum() + higher_value), np.atleast_1d(V_sizes.sum()))
    reason = f"V is off by {error:.2g} in the box"
    checks.append(at_most("value_rel_error", error, limit, reason))
    error = entry_error(2.0 * V_errors.sum(axis=1) + higher_slopes, 2.0 * V_sizes.sum(axis=1))
    reason = f"a slope of V is off by {error:.2g} in the box"
    checks.append(at_most("gradient_rel_error", error, limit, reason))
    if math.isfinite(game.delta) and game.E.size:
        error = entry_error(d_errors, np.abs(exact.disturbance_gain) @ box)
        reason = f"the worst disturbance is off by {error:.2g} in the box"
        checks.append(at_most("disturbance_rel_error", error, limit, reason))
    return tuple(checks)


def _higher_terms(critic: Critic, box: np.ndarray) -> tuple[float, np.ndarray]:
    """Bounds over the box, and over the boxes λb, of the terms of V that are not quadratic, and
    (n,) of b_i times their slopes."""
    psi = critic.basis
    if critic.weights is None or psi is None or psi.size == psi.quadratic_size:
        return 0.0, np.zeros(len(box))
    exponents = psi.exponents[psi.quadratic_size :]
    sizes = np.abs(critic.weights[psi.quadratic_size :])
    with np.errstate(all="ignore"):
        reach = REACH ** np.abs(exponents.sum(axis=1) - 2)
        terms = sizes * np.prod(box**exponents, axis=1) * reach
    return float(terms.sum()), terms @ exponents
