"""Results of learners, without a verdict: weights, residual and what recorded data can tell."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.basis import basis
from hfa_aircraft.signals import UNNAMED, PlantNames
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Vector, storable, without_empty
from hfa_support.reporting.text import Table, entry_rows, matrix_table

if TYPE_CHECKING:
    from controller.critic.critic import Critic
    from controller.game.zero_sum import Game


#: Largest residual of a settled critic, relative to the costs.
SETTLED = 1e-9


@dataclass(frozen=True, eq=False)
class DataSummary(Result):
    """What recorded transitions can tell of a linear plant.

    rows: number of transitions that were used
    episodes: number of runs of successive transitions, or 0 if none follow each other
    rank: that of the states, inputs and disturbances, which is their number: data of a lower rank
        are refused
    condition: ratio of the largest to the smallest singular value of the states, inputs and
        disturbances, in units of their sizes
    misfit: largest relative deviation of a state from the linear fit
    noise: standard deviation of these deviations, (n,), of rates or states in the game's units
    hold: time for which inputs are constant, s, of samples of a game in continuous time, or None
    notes: sentences on what was assumed, and on what contradicts a linear plant
    """

    rows: int
    episodes: int
    rank: int
    condition: float
    misfit: float
    noise: Vector
    hold: float | None = None
    notes: tuple[str, ...] = ()

    def text(self) -> str:
        """Return rows, rank, condition and misfit in one line."""
        parts = [f"{self.rows} transitions"]
        if self.episodes:
            parts[0] += f" of {self.episodes} episode{'s' if self.episodes > 1 else ''}"
        if self.hold is not None:
            parts.append(f"inputs held for {self.hold:.4g} s")
        parts.append(f"states and inputs of rank {self.rank} of {self.rank}")
        parts.append(f"condition {self.condition:.3g}")
        parts.append(f"misfit of a linear plant {100.0 * self.misfit:.2g} %")
        return ", ".join(parts)


@dataclass(frozen=True, eq=False, repr=False)
class TrainingRun(Result, Reported):
    """Result of one learner on one game.

    law: name of the learner
    basis: name of the basis ψ
    W: (M,), learned weights, V = W'ψ(z), in the units of the model
    residual_norm: Bellman residual of the game at the random states, |e| / |z'Qz|
    K: (m, n), gain of the weights
    seed: seed of the random states
    diagnostics: name -> further number
    data: what recorded data can tell, or None for exact data of the learner's own
    P_band, K_band: half-widths of the 95 % bands of P and K, of recorded data whose deviations can
        be independent noise, else None
    H: Q-function of a game in discrete time, Q(x, u, w) = [x; u; w]' H [x; u; w], or None
    names: names of the states and inputs of the game

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]])
    >>> run = hfa.learn(game, seed=1)
    >>> run.W.round(4).tolist(), run.critic(game).K.round(4).tolist()
    ([2.4142], [[2.4142]])
    """

    schema = "hfa.learning-result/1"

    law: str
    basis: str
    W: Vector
    residual_norm: float
    K: Matrix
    seed: int
    diagnostics: dict[str, float] = field(default_factory=dict)
    names: PlantNames = UNNAMED
    H: Matrix | None = None
    data: DataSummary | None = None
    P_band: Matrix | None = None
    K_band: Matrix | None = None

    def critic(self, game: Game) -> Critic:
        """Return the critic of W with the policy u = -K z, or of H, for the given game."""
        from controller.critic.critic import from_parts, from_q_function

        if self.H is not None:
            return from_q_function(game, self.H)
        return from_parts(game, {"W": self.W, "K": self.K}, self.basis)

    @property
    def P(self) -> Matrix:
        """Matrix P (n, n) of the quadratic part z'P z of the value."""
        return basis(self.basis, self.K.shape[1]).matrix(self.W)

    @property
    def weight_units(self) -> list[str]:
        """Unit of each weight as text, (M,), for a value V without a unit.

        The unit of the weight of a product of a speed and an angle is "1/((ft/s) (rad))". The list
        is empty if the units of the states are unknown.
        """
        state_units = self.names.state_units
        if not any(state_units):
            return []
        units = np.array([f"({unit})" for unit in state_units], dtype=object)
        exponents = basis(self.basis, self.K.shape[1]).exponents
        # The unit of a state is repeated by its power in the monomial.
        return [f"1/({' '.join(np.repeat(units, row))})" for row in exponents]

    @property
    def outcome(self) -> str:
        """ "settled", or a sentence with the reason why the run has not settled.

        A run has settled if `residual_norm` is at most `SETTLED`; its critic may still be wrong.
        For recorded data that are not linear, or noisy, the misfit of their linear fit follows, and
        for samples in continuous time that no mode is assumed to be faster than π/hold, which they
        cannot show.
        """
        said = "settled"
        if not self.residual_norm <= SETTLED:  # true for a nan too
            last = self.residual_norm
            said = f"the residual does not settle: {last:.3g} at the end, above {SETTLED:g}"
        elif self.data is not None and self.data.misfit > SETTLED:
            percent = f"{100.0 * self.data.misfit:.2g} %"
            said += f", but the data deviate from a linear plant by {percent}"
        if self.data is not None and self.data.hold is not None:
            said += f"; assumed: no mode faster than {math.pi / self.data.hold:.3g} rad/s"
        return said

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        entries = super()._entries() | {"P": self.P, "status": self.outcome}
        del entries["names"]  # the format has no names of signals
        return entries | without_empty(weight_units=self.weight_units)

    def report(self) -> Report:
        """Return a report with the outcome, P and K.

        `hfa verify --weights` reads W, K and H of its data.
        """
        m, n = self.K.shape
        names = self.names.completed(n, m)
        parts: list[Any] = [
            f"Residual: {self.residual_norm:.2g} of the costs (settled: {SETTLED:g})",
            matrix_table("P", names.states, names.states, self.P),
            matrix_table("K", names.inputs, names.states, self.K),
        ]
        records = entry_rows((self.P,), (self.K,), names)
        if self.data is not None:
            noise = zip(names.states, self.data.noise.tolist(), strict=True)
            of_states = ", ".join(f"{name} {deviation:.3g}" for name, deviation in noise)
            kind = "rates" if self.data.hold is None and self.H is None else "next states"
            of_data = [f"Recorded: {self.data.text()}", f"Noise of {kind}: {of_states}"]
            parts = [*of_data, *self.data.notes, *parts]
            if self.P_band is None or self.K_band is None:
                parts.append(f"No bands: the data do not show independent noise of {kind}")
            else:
                of_P = matrix_table("±P", names.states, names.states, self.P_band)
                of_K = matrix_table("±K", names.inputs, names.states, self.K_band)
                parts += [f"95 % bands, if the noise of {kind} is independent:", of_P, of_K]
                bands = entry_rows((self.P_band,), (self.K_band,), names)
                records += [(f"{matrix}_band", *entry) for matrix, *entry in bands]
        if numbers := [(name, f"{value:.4g}") for name, value in self.diagnostics.items()]:
            parts.append(Table(("number of the law", "value"), numbers))
        return Report(
            title=f"Law {self.law!r}, basis {self.basis!r}, on {names.origin}: {self.outcome}",
            parts=tuple(parts),
            data=storable(self),
            records=Table(("matrix", "row", "column", "value", "unit"), records),
        )
