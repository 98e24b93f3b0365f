"""What the check of a critic says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.basis import Basis
from controller.game.learning_result import LearningResult
from hfa_model.support.checks import checks_block
from hfa_model.support.report import Report
from hfa_model.support.text import Table, numbered
from verification.critic.diagnosis import relative_error

if TYPE_CHECKING:
    from verification.critic.critic_check import CriticCheck


def check_report(
    check: CriticCheck, states: tuple[str, ...] = (), inputs: tuple[str, ...] = (), origin: str = "the plant"
) -> Report:
    """The verdict, every check, the margins beside the exact ones, and P and K entry by entry."""
    m, n = check.exact.K.shape
    states, inputs = states or numbered("x", n), inputs or numbered("u", m)
    records = _entries(check, states, inputs)
    rows = [
        (f"{name}({row}, {column})", f"{learned:.8g}", f"{exact:.8g}", f"{learned - exact:+.2e}")
        for name, row, column, learned, exact in records.rows
        if name == "K" or states.index(row) <= states.index(column)
    ]
    learned, exact = check.learned_margin, check.exact_margin
    margins = [
        (said, "-" if learned is None else f"{getattr(learned, name):.4g}", f"{getattr(exact, name):.4g}")
        for said, name in (("disk", "disk"), ("gain", "gain"), ("phase, deg", "phase"))
    ]
    return Report(
        title=f"Critic on {origin}, against the exact game solution: {'agrees' if check.ok else 'REFUSED'}",
        parts=(
            *([f"Reason: {check.diagnosis}"] if check.diagnosis else []),
            checks_block(check.checks),
            Table(("margins, all inputs", "learned", "exact"), margins),
            Table(("entry", "learned", "exact", "difference"), rows),
        ),
        data=check.to_dict(),
        records=records,
    )


def _entries(check: CriticCheck, states: tuple[str, ...], inputs: tuple[str, ...]) -> Table:
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


def error_over_time(check: CriticCheck, run: LearningResult, basis: Basis) -> np.ndarray:
    """|P(t) - P*| / |P*| of every recorded time, (N,)."""
    return np.array([relative_error(basis.matrix(weights), check.exact.P) for weights in run.weights])
