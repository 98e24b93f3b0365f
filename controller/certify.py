"""The certificates of a learned value, computed from the game itself, and the result that carries them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game import Game
from controller.result import Certificate, Excitation, LearningResult
from controller.stack_equations import StackEquations

#: Largest relative Riccati residual, |A'P + PA + Q - PSP| over the sum of the norms of its terms.
RESIDUAL_LIMIT = 1e-9
#: Largest next Newton correction of P over |P|: to first order the relative error of P.
CORRECTION_LIMIT = 1e-9
#: Largest weight beyond the quadratic ones over the largest quadratic one, in scaled coordinates.
BEYOND_LIMIT = 1e-9


def conclude(
    law: str,
    game: Game,
    equations: StackEquations,
    history: Mapping[str, np.ndarray],
    richness: Excitation,
    settings: dict[str, Any],
    seed: int,
    diagnostics: dict[str, float],
) -> LearningResult:
    """The result of a finished run: P and K of its last weights, with their certificates and status."""
    weights = history["weights"][-1]
    P = equations.basis.matrix(weights)
    rows = certificates(game, equations, weights, richness)
    failed = [str(row) for row in rows if not row.ok]
    return LearningResult(
        law=law,
        basis=equations.basis.name,
        times=history["time"],
        weights=history["weights"],
        residual_norm=history["residual_norm"],
        law_residual_norm=history["law_residual_norm"],
        P=P,
        K=game.gain(P),
        excitation=richness,
        settling_time=settling_time(history["time"], history["residual_norm"]),
        certificates=rows,
        status="converged" if not failed else f"failed: {'; '.join(failed)}",
        settings=settings,
        seed=seed,
        diagnostics=diagnostics,
    )


def certificates(
    game: Game, equations: StackEquations, weights: np.ndarray, richness: Excitation
) -> tuple[Certificate, ...]:
    """The checks of a learned value W'ψ(z), weights (M,) in the model's units.

    A - S P Hurwitz is what singles out the one root of the Riccati equation that is the value of the game: a
    small residual alone does not, and neither does one on a stack of rank below M.
    """
    scales = equations.scales
    P = equations.basis.matrix(weights)
    scaled = P * np.outer(scales, scales)
    eigenvalues = np.linalg.eigvalsh(scaled)
    definite = bool(np.linalg.eigvalsh(game.Q)[0] > 0.0)
    rows = [
        Certificate("abscissa of A - S P [1/s]", abscissa(game.A - game.S @ P), "<", 0.0),
        Certificate("abscissa of A - B K [1/s]", abscissa(game.A - game.B @ game.gain(P)), "<", 0.0),
        Certificate(
            "smallest eigenvalue of scaled P over the largest",
            float(eigenvalues[0] / np.abs(eigenvalues).max()) if np.any(scaled) else 0.0,
            # With Q > 0 the value is positive definite; otherwise states that cost nothing may have value 0.
            ">" if definite else ">=",
            0.0 if definite else -1e-10,
        ),
        Certificate("relative Riccati residual", relative_residual(game, P, scales), "<=", RESIDUAL_LIMIT),
        Certificate("next Newton correction over |P|", newton_correction(game, P, scales), "<=", CORRECTION_LIMIT),
        Certificate("rank of the stack", float(richness.rank), ">=", float(richness.size)),
        Certificate("smallest eigenvalue of Sigma", richness.smallest_eigenvalue, ">", richness.rounding),
    ]
    if equations.basis.size > equations.basis.quadratic_size:
        magnitudes = np.abs(equations.scaled(weights))
        quadratic = equations.basis.quadratic_size
        beyond = float(magnitudes[quadratic:].max() / magnitudes[:quadratic].max())
        rows.append(Certificate("largest weight beyond the quadratic ones", beyond, "<=", BEYOND_LIMIT))
    return tuple(rows)


def abscissa(matrix: np.ndarray) -> float:
    """Largest real part of the eigenvalues, 1/s."""
    return float(np.linalg.eigvals(matrix).real.max())


def relative_residual(game: Game, P: np.ndarray, scales: np.ndarray) -> float:
    """|A'P + PA + Q - PSP| / (2 |A'P| + |Q| + |PSP|) in coordinates z / scales, Frobenius norms."""
    outer = np.outer(scales, scales)
    terms = (2.0 * game.A.T @ P, game.Q, P @ game.S @ P)
    total = sum(float(np.linalg.norm(term * outer)) for term in terms)
    return float(np.linalg.norm(game.residual(P) * outer)) / total


def newton_correction(game: Game, P: np.ndarray, scales: np.ndarray) -> float:
    """|N| / |P| with (A - S P)'N + N (A - S P) = -(A'P + PA + Q - PSP), Frobenius norms; inf when singular.

    Solved as n² linear equations in coordinates z / scales.
    """
    outer = np.outer(scales, scales)
    closed = (game.A - game.S @ P) * scales[None, :] / scales[:, None]
    eye = np.eye(len(P))
    operator = np.kron(closed.T, eye) + np.kron(eye, closed.T)
    try:
        correction = np.linalg.solve(operator, -(game.residual(P) * outer).reshape(-1)).reshape(P.shape) / outer
    except np.linalg.LinAlgError:
        return np.inf
    return float(np.linalg.norm(correction) / np.linalg.norm(P)) if np.any(P) else np.inf


def settling_time(times: np.ndarray, residual_norm: np.ndarray) -> float:
    """The first time from which residual_norm stays at or below RESIDUAL_LIMIT, s; inf when it does not."""
    above = np.flatnonzero(~(residual_norm <= RESIDUAL_LIMIT))
    if len(above) == 0:
        return float(times[0])
    return float(times[above[-1] + 1]) if above[-1] + 1 < len(times) else np.inf
