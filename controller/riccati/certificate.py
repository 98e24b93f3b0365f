"""The certificate of a game solution: the tests that tell the value of the game from other roots, a
second derivation.

A root P of the Riccati equation can have a residual of 1e-13 and still be worthless: it may be
non-stabilizing, or indefinite (delta below its minimum), or the solution of another game. Only all
the tests together count."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import (
    NormalForm,
    balanced_units,
    in_units,
    is_hurwitz,
    normal_form,
    spectrum,
    stable_graph,
)
from controller.riccati.gare_schur import schur_solution
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, Checked, at_least, at_most, below, checked

#: Four orders above rounding: closer to the axis, rounding hides whether the spectrum of the
#: Hamiltonian splits.
AXIS_DISTANCE = 1e-12
#: At this distance it has an eigenvalue on the imaginary axis for all that can be said.
ON_THE_AXIS = 1e-14
RESIDUAL = 1e-10
ASYMMETRY = 1e-12
INDEFINITENESS = 1e-10
DISAGREEMENT = 1e-8
#: Convergence ends quadratically, but starts with about 2 (delta/delta_min - 1)^(-1/2) steps of
#: growth: 5 steps far from the smallest delta, 60 within a thousandth of it, 200 within a
#: ten-thousandth.
MAX_STEPS = 300
#: A correction below this part of X comes of the end, where the next ones only remove what rounding
#: left.
SETTLING = 1e-9


@dataclass(frozen=True)
class Certificate(Checked):
    """Every test that P went through; it counts only when all of them hold."""

    checks: tuple[Check, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values: {"ok": bool, "checks": [{"name", "value", "limit", "ok", "reason"},
        ...]}."""
        return {"ok": self.ok, "checks": [check.to_dict() for check in self.checks]}


def certified_solution(game: Game) -> tuple[np.ndarray, Certificate]:
    """P of A'P + P A + Q - P S P = 0 and its certificate, all of whose tests hold.

    P: (n, n) symmetric, read-only. Everything is measured in balanced units of state, so that the
    verdict does not depend on the user's units.  Raises NoSolutionError with the reason of the
    first test that failed; a failure of the first derivation is reported before the second one is
    computed. Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11; Zhou, Doyle and
    Glover, Chapter 13."""
    checks = hamiltonian_checks(game)
    refuse_failures(checks)
    P = first_derivation(game)
    checks += solution_checks(game, P)
    refuse_failures(checks)
    checks += (agreement_check(game, P, iterated_solution(game)),)
    refuse_failures(checks)
    P.setflags(write=False)
    return P, Certificate(checks)


def hamiltonian_checks(game: Game) -> tuple[Check, ...]:
    """H = [[A, -S], [-Q, -A']] must have n eigenvalues on each side of the imaginary axis, and none
    near it."""
    n = len(game.A)
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    found = spectrum(H)
    stable = int(np.sum(found.eigenvalues.real < 0.0))
    distance, frequency = found.nearest_to_axis()
    where = "on" if distance <= ON_THE_AXIS else "within rounding of"
    near = f"the Hamiltonian has an eigenvalue {where} the imaginary axis at {frequency:.4g} rad/s"
    split = f"the Hamiltonian has {stable} stable eigenvalues instead of {n}"
    return (
        at_least("hamiltonian_axis_distance", distance, AXIS_DISTANCE, near),
        checked("hamiltonian_split", stable, "==", n, split),
    )


def solution_checks(game: Game, P: np.ndarray) -> tuple[Check, ...]:
    """The tests of P alone: equation, symmetry, sign, and both closed loops."""
    if not np.all(np.isfinite(P)):
        return (at_most("residual", np.nan, RESIDUAL, "P has entries that are not finite"),)
    units = balanced_units(game)
    balanced, scaled_P = in_units(game, units), P * np.outer(units, units)
    residual = relative_residual(balanced, scaled_P)
    size = _size(scaled_P)
    asymmetry = float(np.abs(scaled_P - scaled_P.T).max()) / size
    smallest = float(np.linalg.eigvalsh(scaled_P)[0]) / size
    game_loop = spectrum(game.A - game.S @ P).abscissa
    control_loop = spectrum(game.A - game.B @ game.gain(P)).abscissa
    sign = f"P is indefinite (smallest eigenvalue {smallest:.3g} of the largest entry)"
    return (
        at_most(
            "residual",
            residual,
            RESIDUAL,
            f"the Riccati equation is left with a residual of {residual:.2g}",
        ),
        at_most("symmetry", asymmetry, ASYMMETRY, f"P is not symmetric ({asymmetry:.2g} relative)"),
        at_least("positive_semidefinite", smallest, -INDEFINITENESS, sign),
        below(
            "game_loop_abscissa",
            game_loop,
            0.0,
            f"A - S P is not Hurwitz (abscissa {game_loop:+.3g} 1/s)",
        ),
        below(
            "control_loop_abscissa",
            control_loop,
            0.0,
            f"A - B K is not Hurwitz (abscissa {control_loop:+.3g} 1/s)",
        ),
    )


def agreement_check(game: Game, P: np.ndarray, second_P: np.ndarray) -> Check:
    """max |P - P2| / max |P| in balanced units: the two derivations must give one answer."""
    units = balanced_units(game)
    squared = np.outer(units, units)
    difference = float(np.abs((P - second_P) * squared).max()) / _size(P * squared)
    reason = f"the Lanzon-Feng-Anderson iteration gives another P (difference {difference:.2g})"
    return at_most("second_derivation", difference, DISAGREEMENT, reason)


def iterated_solution(game: Game) -> np.ndarray:
    """X₀ = 0,  X_{k+1} = X_k + Z_k  with  A_k'Z + Z A_k - Z B B' Z + F_k = 0,  A_k = A - S X_k, in
    normal form.

    The second derivation, by a sequence of standard (definite) Riccati equations. F_k is the
    residual of the game's at X_k, Z E E' Z >= 0 but for rounding: each step is an LQR problem,
    solved by a Schur form of its Hamiltonian. The sequence increases to the smallest solution X >=
    0 if there is one; if there is none, some step has no stabilizing solution, or the sequence
    grows without end. Returns P, (n, n). Raises NoSolutionError when no positive semidefinite
    stabilizing solution exists. Source: Lanzon, Feng, Anderson and Rotkowitz, IEEE Trans. Automatic
    Control 53 (2008), 2280-2291."""
    form = normal_form(game)
    X = best = np.zeros_like(form.A)
    smallest, size = np.inf, 0.0
    for step in range(1, MAX_STEPS + 1):
        Z = _lqr_step(form, X, step)
        X, correction = X + Z, float(np.abs(Z).max())
        size = max(size, float(np.abs(X).max()))  # of a P of 0 nothing but rounding is left
        if smallest <= SETTLING * size and correction > 0.5 * smallest:  # no digit more
            return form.value(best)
        best, smallest = X, correction
        if correction <= 4.0 * np.finfo(float).eps * size:
            return form.value(X)
    raise NoSolutionError(f"the Lanzon-Feng-Anderson iteration did not settle in {MAX_STEPS} steps")


def _lqr_step(form: NormalForm, X: np.ndarray, step: int) -> np.ndarray:
    """Stabilizing Z of A_k'Z + Z A_k - Z B B' Z + F = 0, solved with Z scaled to one.

    With Z = c Y and F = c G the equation becomes A_k'Y + Y A_k - Y c B B' Y + G = 0. Z is of the
    size of F, and at least of that of A_k / B B' where A_k must be stabilized."""
    A, forcing = form.A - form.S @ X, form.residual(X)
    scale = float(np.abs(forcing).max()) or 1.0
    if not is_hurwitz(A):
        scale = max(scale, float(np.abs(A).max()) / (float(np.abs(form.B).max()) ** 2 or 1.0))
    try:
        Z = scale * stable_graph(
            np.block([[A, -scale * form.B @ form.B.T], [-forcing / scale, -A.T]])
        )
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(
            f"step {step} of the Lanzon-Feng-Anderson iteration has no solution"
        ) from error
    Z = (Z + Z.T) / 2.0
    if (
        not np.all(np.isfinite(Z))
        or np.linalg.eigvals(A - form.B @ (form.B.T @ Z)).real.max() >= 0.0
    ):
        raise NoSolutionError(
            f"step {step} of the Lanzon-Feng-Anderson iteration is not stabilizing"
        )
    return Z


def relative_residual(game: Game, P: np.ndarray) -> float:
    """`relative_residuals` of one game."""
    return float(
        relative_residuals(game.A, game.S_control, game.S_disturbance / game.delta**2, game.Q, P)
    )


def relative_residuals(
    A: np.ndarray, S_control: np.ndarray, S_disturbance: np.ndarray, Q: np.ndarray, P: np.ndarray
) -> np.ndarray:
    """max |A'P + P A + Q - P S P| / max (|A|'|P| + |P||A| + |Q| + |P||S||P|), entry by entry
    absolute values.

    Of one matrix or of stacks (..., n, n). |S| denotes |B R⁻¹ B'| + |E E'|/δ²: cancellation between
    the two players does not count as smallness."""
    turned, size = A.mT, np.abs(P)
    residual = turned @ P + P @ A + Q - P @ (S_control - S_disturbance) @ P
    terms = np.abs(turned) @ size + size @ np.abs(A) + np.abs(Q)
    terms += size @ (np.abs(S_control) + np.abs(S_disturbance)) @ size
    largest = np.abs(terms).max(axis=(-1, -2))
    return np.asarray(np.abs(residual).max(axis=(-1, -2)) / np.where(largest > 0.0, largest, 1.0))


def first_derivation(game: Game) -> np.ndarray:
    """P = 0 where nothing is paid for and A is Hurwitz: there `schur_solution`, asked otherwise,
    finds rounding."""
    if not game.Q.any() and is_hurwitz(game.A):
        return np.zeros(game.A.shape)
    return schur_solution(game)


def refuse_failures(checks: tuple[Check, ...]) -> None:
    """NoSolutionError with the reason of the first that failed."""
    for check in checks:
        if not check.ok:
            raise NoSolutionError(check.reason)


def _size(matrix: np.ndarray) -> float:
    return float(np.abs(matrix).max()) or 1.0
