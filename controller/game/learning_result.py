"""What every learning law returns: weights over time, the learned P and K, the checks on them; and
what it says."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from controller.game.basis import basis
from hfa_support.jsonable import jsonable
from hfa_support.reporting.checks import Check, verdict_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import RowsMade, Table, matrix_table, numbered

SCHEMA = "hfa.learning-result/1"
_HISTORY = ("times", "weights", "residual_norm", "law_residual_norm")


@dataclass(frozen=True)
class Excitation:
    """Richness of a recorded stack: Σ = Σ_j σ̄_j σ̄_j' (paper Assumption 1), σ̄ = σ / sqrt(1 +
    σ'σ).

    rank: of the (N_h, M) matrix of ψ(z_j), each row of length 1 (`recording.excitation` says why),
    singular values below `recording.RANK_TOLERANCE` times the largest counting as 0. size: M.
    smallest_eigenvalue: of Σ (paper λ_0). condition: largest singular value over smallest of that
    matrix. rounding: what rounding alone can make of a smallest eigenvalue of 0, (N_h ε)² times the
    largest eigenvalue of Σ."""

    rank: int
    size: int
    samples: int
    smallest_eigenvalue: float
    condition: float
    rounding: float


@dataclass(frozen=True, eq=False, repr=False)
class LearningResult(Reported):
    """The outcome of one learning law on one game.

    times: (N,), s. weights: (N, M), W with V = W'ψ(z) in the units of the model. residual_norm:
    (N,), Bellman residual of the game over the stack, |e| / |z'Qz|. law_residual_norm: (N,), the
    residual that the law itself drives to zero at that time (in the law's own normalisation and
    stage). P: (n, n), K: (m, n), learned at the last time. settling_time: first time from which |e|
    stays below `certify.RESIDUAL_LIMIT` of the size of the terms that cancel in it, s; inf when it
    does not. diagnostics: further numbers of the law by name."""

    law: str
    basis: str
    times: np.ndarray
    weights: np.ndarray
    residual_norm: np.ndarray
    law_residual_norm: np.ndarray
    P: np.ndarray
    K: np.ndarray
    excitation: Excitation
    settling_time: float
    certificates: tuple[Check, ...]
    settings: dict[str, Any]
    seed: int
    diagnostics: dict[str, float] = field(default_factory=dict)

    @property
    def converged(self) -> bool:
        """Whether every certificate holds."""
        return all(row.ok for row in self.certificates)

    @property
    def outcome(self) -> str:
        """converged, or "failed: " and every certificate that does not hold."""
        failed = [row.sentence for row in self.certificates if not row.ok]
        return f"failed: {'; '.join(failed)}" if failed else "converged"

    def report(
        self,
        states: tuple[str, ...] = (),
        inputs: tuple[str, ...] = (),
        origin: str = "",
        state_units: tuple[str, ...] = (),
        input_units: tuple[str, ...] = (),
        *,
        history: bool = False,
    ) -> Report:
        """Status, certificates, excitation, P and K; names and units of the plant where there are
        any.

        data: the outcome with the last weights under `W` (what `hfa verify --weights` reads); with
        `history` also all rows over time."""
        m, n = self.K.shape
        states, inputs = states or numbered("x", n), inputs or numbered("u", m)
        of_states = state_units or ("",) * n
        settled = f"{self.settling_time:.4g} s" if math.isfinite(self.settling_time) else "not"
        excitation, numbers = (
            self.excitation,
            [(name, f"{value:.4g}") for name, value in self.diagnostics.items()],
        )
        certificates = [
            (row.name, f"{row.value:.3g}", f"{row.relation} {row.limit:.3g}", verdict_text(row.ok))
            for row in self.certificates
        ]
        units = basis(self.basis, n).weight_units(of_states) if any(of_states) else []
        columns = [
            f"W{i}{f' [{units[i - 1]}]' if units else ''}"
            for i in range(1, len(self.weights[0]) + 1)
        ]
        over_time = self.times, self.residual_norm, self.law_residual_norm
        data = self.to_dict()
        rows = {name: data.pop(name) for name in _HISTORY}
        data |= {"W": self.weights[-1].tolist(), "converged": self.converged} | (
            {"weight_units": units} if units else {}
        )
        return Report(
            title=f"Law {self.law!r}, basis {self.basis!r}{f', on {origin}' if origin else ''}: {self.outcome}",
            parts=(
                f"Residual settled: {settled}; last residual {self.residual_norm[-1]:.3g}",
                f"Data: {excitation.samples} samples, rank {excitation.rank} of {excitation.size}, smallest eigenvalue "
                f"of Sigma {excitation.smallest_eigenvalue:.3g}, condition {excitation.condition:.3g}",
                Table(("certificate", "value", "limit", "verdict"), certificates),
                matrix_table("P", states, states, self.P),
                matrix_table("K", inputs, states, self.K),
                *([Table(("number of the law", "value"), numbers)] if numbers else []),
            ),
            data=data | rows if history else data,
            records=Table(
                ("time [s]", "residual_norm", "law_residual_norm", *columns),
                RowsMade(
                    len(self.times),
                    lambda i: (*(column[i] for column in over_time), *self.weights[i]),
                ),
            ),
        )

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain JSON values; a number that is not finite becomes None."""
        certificates = [row._asdict() for row in self.certificates]
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        structured = {
            "excitation": asdict(self.excitation),
            "certificates": certificates,
            "status": self.outcome,
        }
        plain: dict[str, Any] = jsonable({"schema": SCHEMA} | values | structured)
        return plain


def settled_at(times: np.ndarray, sizes: np.ndarray, limit: float) -> float:
    """First time from which sizes (N,) stay within the limit to the end, s; inf when the last one
    does not."""
    above = np.flatnonzero(~(sizes <= limit))
    first = int(above[-1]) + 1 if len(above) else 0
    return float(times[first]) if first < len(times) else np.inf
