"""Results of learners, without a verdict: weights over time and the rank of the data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.basis import basis
from hfa_aircraft.names import UNNAMED, PlantNames
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Vector, given
from hfa_support.reporting.text import RowsMade, Table, matrix_table

if TYPE_CHECKING:
    from controller.critic.critic import Critic
    from controller.game.zero_sum import Game


def settled_at(times: np.ndarray, sizes: np.ndarray, limit: float) -> float:
    """Return the settling time, the first of the times from which all sizes stay at or below a
    limit.

    The result is inf if the last size exceeds the limit or is NaN.

    times: (N,), increasing
    sizes: (N,), magnitude of the signal at each time
    limit: limit of the sizes
    """
    above = np.flatnonzero(~(sizes <= limit))
    first = int(above[-1]) + 1 if len(above) else 0
    return float(times[first]) if first < len(times) else np.inf


#: Largest residual of a settled critic, relative to the terms that cancel in it.
SETTLED = 1e-9
#: Entries of the file over time by the clock. A history in s is read as a critic over time.
_HISTORY = {
    "s": ("times", "weights", "residual_norm"),
    "iterations": ("iterations", "iterates", "residual_norm"),
}


@dataclass(frozen=True)
class Excitation(Result):
    """Excitation of recorded data (paper Assumption 1).

    rank: rank of the (N_h, M) matrix with the rows ψ(z_j)/|ψ(z_j)|; singular values below
        `recording.RANK_TOLERANCE` times the largest count as 0
    size: number of weights M
    samples: number of samples N_h
    condition: ratio of the largest to the smallest singular value of the matrix with the rows
        ψ(z_j)/|ψ(z_j)|
    """

    rank: int
    size: int
    samples: int
    condition: float


@dataclass(frozen=True, eq=False, repr=False)
class TrainingRun(Result, Reported):
    """Training run of one learner on one game.

    law: name of the learner
    basis: name of the basis ψ
    time: (N,), in units of `clock`
    weights: (N, M), W with V = W'ψ(z), in the units of the model
    residual_norm: (N,), Bellman residual of the game on the recorded data, |e| / |z'Qz|
    settling_residual: (N,), |e| divided by the magnitude of the terms of e
    K: (m, n), gain of the last weights
    excitation: rank of the data
    seed: seed of the data
    diagnostics: name -> further number; "drift_misfit" is the relative deviation of the recorded
        drifts from F = A z (`Stack.linear`)
    H: Q-function of a game in discrete time, Q(x, u, w) = [x; u; w]' H [x; u; w], or None
    names: names of the states and inputs of the game
    clock: unit of `time`: s, or iterations
    """

    schema = "hfa.learning-result/1"

    law: str
    basis: str
    time: Vector
    weights: Matrix
    residual_norm: Vector
    settling_residual: np.ndarray
    K: Matrix
    excitation: Excitation
    seed: int
    diagnostics: dict[str, float] = field(default_factory=dict)
    names: PlantNames = UNNAMED
    clock: str = "s"
    H: Matrix | None = None

    def critic(self, game: Game) -> Critic:
        """Return the critic of the last weights, or of H, for the given game."""
        from controller.critic.critic import from_q_function, from_weights

        if self.H is not None:
            return from_q_function(game, self.H)
        return from_weights(game, self.weights[-1], self.basis)

    @property
    def P(self) -> Matrix:
        """Matrix P (n, n) of the quadratic part z'P z of the last value."""
        return basis(self.basis, self.K.shape[1]).matrix(self.weights[-1])

    @property
    def W(self) -> Vector:
        """Last weights of the basis, (M,)."""
        return self.weights[-1]

    @property
    def weight_units(self) -> list[str]:
        """Unit of each weight as text, (M,), for a value V without a unit.

        The unit of the weight of a product of a speed and an angle is "1/((ft/s) (rad))". The list
        is empty if the units of the states are unknown.
        """
        state_units = self.names.state_units
        if not any(state_units):
            return []
        units = []
        for row in basis(self.basis, self.K.shape[1]).exponents.tolist():
            factors: list[str] = []
            for unit, power in zip(state_units, row, strict=True):
                factors += power * [f"({unit})"]
            units.append(f"1/({' '.join(factors)})")
        return units

    @property
    def settling_time(self) -> float:
        """First recorded time from which `settling_residual` stays at or below `SETTLED`, in units
        of `clock`.

        The result is inf if the last residual is larger.
        """
        return settled_at(self.time, self.settling_residual, SETTLED)

    @property
    def settled(self) -> bool:
        """True if the data have full rank and `settling_time` is finite.

        The critic of a settled run may still be wrong.
        """
        has_rank = self.excitation.rank >= self.excitation.size
        return has_rank and math.isfinite(self.settling_time)

    @property
    def outcome(self) -> str:
        """ "settled", or a sentence with the reason why the run has not settled.

        The misfit of recorded drifts that are not linear in z, or noisy, follows "settled". The
        learned gain is that of their linear fit.
        """
        if self.excitation.rank < self.excitation.size:
            return f"the data have rank {self.excitation.rank} of {self.excitation.size}"
        if not math.isfinite(self.settling_time):
            last = self.settling_residual[-1]
            return f"the residual does not settle: {last:.3g} at the end, above {SETTLED:g}"
        misfit = self.diagnostics.get("drift_misfit", 0.0)
        if misfit > SETTLED:
            percent = f"{100.0 * misfit:.2g} %"
            return f"settled, but the recorded drifts deviate from F = A z by {percent}"
        return "settled"

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "law": self.law,
            "basis": self.basis,
            "K": self.K,
            "excitation": self.excitation,
            "seed": self.seed,
            "diagnostics": self.diagnostics,
            "clock": self.clock,
            "P": self.P,
            "W": self.W,
            "settling_time": self.settling_time,
            "status": self.outcome,
        } | given(
            **dict(zip(_HISTORY[self.clock], self._over_time, strict=True)),
            weight_units=self.weight_units,
            H=self.H,
        )

    @property
    def _over_time(self) -> tuple[Vector, Matrix, Vector]:
        return self.time, self.weights, self.residual_norm

    def report(self, *, history: bool = False) -> Report:
        """Return a report with the outcome, the rank of the data, P and K.

        The data of the report contain the last weights as `W`. `hfa verify --weights` reads this
        entry.

        history: whether the data also contain the weights and residuals at all times
        """
        m, n = self.K.shape
        names = self.names.completed(n, m)
        data = self.as_data()
        rows_over_time = {name: data.pop(name) for name in _HISTORY[self.clock]}
        if history:
            data |= rows_over_time
        data_rank = self.excitation
        settled = "not"
        if math.isfinite(self.settling_time):
            settled = f"after {self.settling_time:.4g} {self.clock}"
        parts: list[Any] = [
            f"Residual settled: {settled}",
            f"Data: {data_rank.samples} samples, rank {data_rank.rank} of {data_rank.size},"
            f" condition {data_rank.condition:.3g}",
            matrix_table("P", names.states, names.states, self.P),
            matrix_table("K", names.inputs, names.states, self.K),
        ]
        numbers = [
            (name, f"{value:.4g}")
            for name, value in self.diagnostics.items()
            if name != "drift_misfit"  # in the title, if it is not rounding
        ]
        if numbers:
            parts.append(Table(("number of the law", "value"), numbers))
        return Report(
            title=f"Law {self.law!r}, basis {self.basis!r}, on {names.origin}: {self.outcome}",
            parts=tuple(parts),
            data=data,
            records=self._records(),
        )

    def _records(self) -> Table:
        """Return a table of time, residuals and weights, one row for each recorded time."""
        columns = [f"W{i + 1}" for i in range(self.weights.shape[1])]
        units = self.weight_units
        if units:
            columns = [f"{name} [{unit}]" for name, unit in zip(columns, units, strict=True)]
        rows = RowsMade(
            len(self.time), lambda i: (self.time[i], self.residual_norm[i], *self.weights[i])
        )
        return Table((f"time [{self.clock}]", "residual_norm", *columns), rows)
