"""The certificate of a game solution: the tests that tell the value of the game from other roots.

A root P of the Riccati equation can have a residual of 1e-13 and still be worthless: it may be non-stabilizing,
or indefinite (delta below its minimum), or the solution of another game. Only all the tests together count.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from hfa_model.support.checks import Check, at_least, at_most, below
from verification.riccati.spectrum import spectrum
from verification.riccati.units import balanced_units, in_units

#: Four orders above rounding: closer to the axis, the spectrum of the Hamiltonian cannot be told to split.
AXIS_DISTANCE = 1e-12
RESIDUAL = 1e-10
ASYMMETRY = 1e-12
INDEFINITENESS = 1e-10
DISAGREEMENT = 1e-8


@dataclass(frozen=True)
class Certificate:
    """Every test that P went through; it counts only when all of them hold."""

    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """True when every test holds."""
        return all(check.ok for check in self.checks)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The tests that failed, in order."""
        return tuple(check for check in self.checks if not check.ok)

    def __getitem__(self, name: str) -> Check:
        """The test of that name."""
        return {check.name: check for check in self.checks}[name]

    def to_dict(self) -> dict[str, Any]:
        """Plain values: {"ok": bool, "checks": [{"name", "value", "limit", "ok", "reason"}, ...]}."""
        return {"ok": self.ok, "checks": [check.to_dict() for check in self.checks]}


def certify(game: Game, P: np.ndarray, second_P: np.ndarray) -> Certificate:
    """Judge P as the stabilizing, positive semidefinite solution of A'P + P A + Q - P S P = 0.

    P, second_P: (n, n); second_P is the answer of a derivation that shares nothing with the one of P.
    Everything is measured in balanced units of state, so that the verdict does not depend on the user's units.
    Source: Basar and Bernhard, H-infinity Optimal Control, Theorem 4.11; Zhou, Doyle and Glover, Chapter 13.
    """
    return Certificate((*hamiltonian_checks(game), *solution_checks(game, P), agreement_check(game, P, second_P)))


def hamiltonian_checks(game: Game) -> tuple[Check, ...]:
    """H = [[A, -S], [-Q, -A']] must have n eigenvalues on each side of the imaginary axis, and none near it."""
    n = len(game.A)
    H = np.block([[game.A, -game.S], [-game.Q, -game.A.T]])
    found = spectrum(H)
    stable = int(np.sum(found.eigenvalues.real < 0.0))
    nearest = found.eigenvalues[np.argmin(np.abs(found.eigenvalues.real))]
    return (
        at_least(
            "hamiltonian_axis_distance",
            found.axis_distance,
            AXIS_DISTANCE,
            f"the Hamiltonian has an eigenvalue on the imaginary axis at {abs(nearest.imag):.4g} rad/s",
        ),
        Check(
            "hamiltonian_split",
            float(stable),
            float(n),
            stable == n,
            "" if stable == n else f"the Hamiltonian has {stable} stable eigenvalues instead of {n}",
        ),
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
    return (
        at_most("residual", residual, RESIDUAL, f"the Riccati equation is left with a residual of {residual:.2g}"),
        at_most("symmetry", asymmetry, ASYMMETRY, f"P is not symmetric ({asymmetry:.2g} relative)"),
        at_least(
            "positive_semidefinite",
            smallest,
            -INDEFINITENESS,
            f"P is indefinite (smallest eigenvalue {smallest:.3g} of the largest entry)",
        ),
        below(
            "game_loop_abscissa",
            game_loop,
            0.0,
            f"A - S P is not Hurwitz (abscissa {game_loop:+.3g} rad/s)",
        ),
        below(
            "control_loop_abscissa",
            control_loop,
            0.0,
            f"A - B K is not Hurwitz (abscissa {control_loop:+.3g} rad/s)",
        ),
    )


def agreement_check(game: Game, P: np.ndarray, second_P: np.ndarray) -> Check:
    """max |P - P2| / max |P| in balanced units: the two derivations must give one answer."""
    units = balanced_units(game)
    squared = np.outer(units, units)
    difference = float(np.abs((P - second_P) * squared).max()) / _size(P * squared)
    return at_most(
        "second_derivation",
        difference,
        DISAGREEMENT,
        f"the Lanzon-Feng-Anderson iteration gives another P (difference {difference:.2g})",
    )


def relative_residual(game: Game, P: np.ndarray) -> float:
    """max |A'P + P A + Q - P S P| / max (|A|'|P| + |P||A| + |Q| + |P||S||P|), entry by entry absolute values.

    |S| stands for |B R⁻¹ B'| + |E E'|/δ²: cancellation between the two players does not count as smallness.
    """
    size = np.abs(P)
    size_S = np.abs(game.S_control) + np.abs(game.S_disturbance) / game.delta**2
    terms = np.abs(game.A).T @ size + size @ np.abs(game.A) + np.abs(game.Q) + size @ size_S @ size
    return float(np.abs(game.residual(P)).max()) / _size(terms)


def _size(matrix: np.ndarray) -> float:
    return float(np.abs(matrix).max()) or 1.0
