"""What a learning run says: as numbers, as a table, and as text for a person."""

from __future__ import annotations

import math
from typing import Any

from controller.game.learning_result import LearningResult
from hfa_model.support.text import Table, columns, matrix_text


def learning_data(result: LearningResult, *, history: bool) -> dict[str, Any]:
    """The outcome with the last weights under `W` (what `hfa verify --weights` reads); with `history` also all rows
    over time."""
    everything = result.to_dict()
    rows = {name: everything.pop(name) for name in ("times", "weights", "residual_norm", "law_residual_norm")}
    data = everything | {"W": result.weights[-1].tolist(), "converged": result.converged}
    return data | rows if history else data


def learning_table(result: LearningResult) -> Table:
    """One row a recorded time: residuals and weights."""
    header = ("time", "residual_norm", "law_residual_norm", *(f"W{i + 1}" for i in range(result.weights.shape[1])))
    rows: list[tuple[Any, ...]] = [
        (time, residual, law, *weights)
        for time, residual, law, weights in zip(
            result.times, result.residual_norm, result.law_residual_norm, result.weights, strict=True
        )
    ]
    return Table(header, rows)


def learning_text(result: LearningResult, states: tuple[str, ...], inputs: tuple[str, ...], origin: str) -> str:
    """Status, certificates, excitation, P and K on a terminal."""
    settled = f"{result.settling_time:.4g} s" if math.isfinite(result.settling_time) else "not"
    excitation = result.excitation
    parts = [
        f"Law {result.law!r}, basis {result.basis!r}, on {origin}: {result.status}",
        f"Residual settled: {settled}; last residual {result.residual_norm[-1]:.3g}",
        f"Data: {excitation.samples} samples, rank {excitation.rank} of {excitation.size}, smallest eigenvalue of "
        f"Sigma {excitation.smallest_eigenvalue:.3g}, condition {excitation.condition:.3g}",
        columns(
            ("certificate", "value", "limit", "verdict"),
            [
                (row.name, f"{row.value:.3g}", f"{row.relation} {row.limit:.3g}", "pass" if row.ok else "FAIL")
                for row in result.certificates
            ],
        ),
        matrix_text("P", states, states, result.P),
        matrix_text("K", inputs, states, result.K),
    ]
    if result.diagnostics:
        parts.append(columns(("number of the law", "value"), [(k, f"{v:.4g}") for k, v in result.diagnostics.items()]))
    return "\n\n".join(parts)
