"""What the check of a critic says: as a table, as text, and as a picture's data."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.game.basis import Basis
from controller.game.learning_result import LearningResult
from hfa_model.support.checks import checks_text
from hfa_model.support.text import Table, columns
from verification.critic.critic_check import CriticCheck
from verification.critic.diagnosis import relative_error


def check_table(check: CriticCheck, states: tuple[str, ...], inputs: tuple[str, ...]) -> Table:
    """Rows (matrix, row, column, learned, exact) of P, where known, and K."""
    pairs: list[tuple[str, tuple[str, ...], Any, Any]] = [("K", inputs, check.candidate.K, check.exact.K)]
    if check.candidate.P is not None:
        pairs.insert(0, ("P", states, check.candidate.P, check.exact.P))
    rows = [
        (name, row, column, learned[i, j], exact[i, j])
        for name, row_names, learned, exact in pairs
        for i, row in enumerate(row_names)
        for j, column in enumerate(states)
    ]
    return Table(("matrix", "row", "column", "learned", "exact"), rows)


def check_text(check: CriticCheck, states: tuple[str, ...], inputs: tuple[str, ...], origin: str) -> str:
    """The verdict, every check, the margins beside the exact ones, and P and K entry by entry."""
    _, entries = check_table(check, states, inputs)
    rows = [
        (f"{name}({row}, {column})", f"{learned:.8g}", f"{exact:.8g}", f"{learned - exact:+.2e}")
        for name, row, column, learned, exact in entries
        if name == "K" or states.index(row) <= states.index(column)
    ]
    learned, exact = check.learned_margin, check.exact_margin
    margins = [
        ("disk", "-" if learned is None else f"{learned.disk:.4g}", f"{exact.disk:.4g}"),
        ("gain", "-" if learned is None else f"{learned.gain:.4g}", f"{exact.gain:.4g}"),
        ("phase, deg", "-" if learned is None else f"{learned.phase:.4g}", f"{exact.phase:.4g}"),
    ]
    parts = [
        f"Critic on {origin}, against the exact game solution: {'agrees' if check.ok else 'REFUSED'}",
        checks_text(check.checks),
        columns(("margins, all inputs", "learned", "exact"), margins),
        columns(("entry", "learned", "exact", "difference"), rows),
    ]
    if check.diagnosis:
        parts.insert(1, f"Reason: {check.diagnosis}")
    return "\n\n".join(parts)


def error_over_time(check: CriticCheck, run: LearningResult, basis: Basis) -> np.ndarray:
    """|P(t) - P*| / |P*| of every recorded time, (N,)."""
    return np.array([relative_error(basis.matrix(weights), check.exact.P) for weights in run.weights])
