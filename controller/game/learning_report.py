"""What a learning run says."""

from __future__ import annotations

import math

from controller.game.learning_result import LearningResult
from hfa_model.reporting.checks import verdict_text
from hfa_model.reporting.report import Report
from hfa_model.reporting.text import RowsMade, Table, matrix_table, numbered

_HISTORY = ("times", "weights", "residual_norm", "law_residual_norm")


def learning_report(
    result: LearningResult,
    states: tuple[str, ...] = (),
    inputs: tuple[str, ...] = (),
    origin: str = "",
    *,
    history: bool = False,
) -> Report:
    """Status, certificates, excitation, P and K; names of the plant where there are any.

    data: the outcome with the last weights under `W` (what `hfa verify --weights` reads); with `history` also all rows
    over time.
    """
    m, n = result.K.shape
    states, inputs = states or numbered("x", n), inputs or numbered("u", m)
    settled = f"{result.settling_time:.4g} s" if math.isfinite(result.settling_time) else "not"
    excitation, numbers = result.excitation, [(name, f"{value:.4g}") for name, value in result.diagnostics.items()]
    certificates = [
        (row.name, f"{row.value:.3g}", f"{row.relation} {row.limit:.3g}", verdict_text(row.ok))
        for row in result.certificates
    ]
    data = result.to_dict()
    rows = {name: data.pop(name) for name in _HISTORY}
    data |= {"W": result.weights[-1].tolist(), "converged": result.converged}
    return Report(
        title=f"Law {result.law!r}, basis {result.basis!r}{f', on {origin}' if origin else ''}: {result.outcome}",
        parts=(
            f"Residual settled: {settled}; last residual {result.residual_norm[-1]:.3g}",
            f"Data: {excitation.samples} samples, rank {excitation.rank} of {excitation.size}, smallest eigenvalue of "
            f"Sigma {excitation.smallest_eigenvalue:.3g}, condition {excitation.condition:.3g}",
            Table(("certificate", "value", "limit", "verdict"), certificates),
            matrix_table("P", states, states, result.P),
            matrix_table("K", inputs, states, result.K),
            *([Table(("number of the law", "value"), numbers)] if numbers else []),
        ),
        data=data | rows if history else data,
        records=_records(result),
    )


def _records(result: LearningResult) -> Table:
    """One row a recorded time: residuals and weights."""
    header = ("time", "residual_norm", "law_residual_norm", *(f"W{i + 1}" for i in range(result.weights.shape[1])))
    columns = result.times, result.residual_norm, result.law_residual_norm
    return Table(
        header, RowsMade(len(result.times), lambda i: (*(column[i] for column in columns), *result.weights[i]))
    )
