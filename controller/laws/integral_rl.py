"""Off-policy integral reinforcement learning with known B and E: the baseline of paper Section 5.2."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from controller.game.basis import Basis, basis
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws import law_settings
from controller.laws.certify import conclude
from controller.laws.run import Run
from controller.training_data import recording
from controller.training_data.bellman_equations import StackEquations
from controller.training_data.recording import Stack, record, refuse_poor, unit_rows
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.schema import POSITIVE, Number

#: Gauss-Legendre nodes per interval: the integrals of the probing flight are then exact to rounding.
NODES = 10
#: Most intervals, each with NODES samples of the flight, and most iterations; a few times M are enough.
MOST_INTERVALS = 10_000
#: A flight beyond this overflows when its states are multiplied.
LARGEST_STATE = 1e100


@dataclass(frozen=True)
class IrlSettings:
    """interval Δ, s; longer ones tell the slow modes apart better. intervals: N >= M of them are simulated, then
    `iterations` policy updates follow, one per Δ; None stands for 40, and for more where the basis has more than 26
    weights (`law_settings.enough_for`).

    form: "game" (both policies are learned) or "lqr" (1/δ² = 0, the nominal controller). initial_weights: W(0)
    of the first policies, model's units; 0 is u = 0 and needs a stable plant. probe: amplitude of the probing
    inputs. disturbance: amplitude of the simulated disturbance. disturbance_measured: whether the learner knows it.
    """

    interval: float = 0.2
    intervals: int | None = None
    iterations: int = 40
    form: str = "game"
    initial_weights: float | tuple[float, ...] = 0.0
    probe: float = 0.05
    disturbance: float = 0.05
    disturbance_measured: bool = True

    def __post_init__(self) -> None:
        """Refuse what cannot run, naming the setting."""
        numbers = {"interval": POSITIVE, "probe": POSITIVE, "disturbance": Number(0.0)}
        law_settings.checked(self, numbers, {"intervals": MOST_INTERVALS, "iterations": MOST_INTERVALS})
        refuse_unknown("form is", self.form, ("game", "lqr"))


#: The scaled weights, and the misfit of the last least squares.
Memory = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Record:
    """Data of N intervals in coordinates z / scales.

    change: (N, M), ψ(z(t+Δ)) - ψ(z(t)). zz, zu, zd: (N, n, n), (N, n, m), (N, n, k), ∫ z z', ∫ z u', ∫ z d'.
    states: (N, n), z(t). scales: (n,).
    """

    change: np.ndarray
    zz: np.ndarray
    zu: np.ndarray
    zd: np.ndarray
    states: np.ndarray
    scales: np.ndarray

    @property
    def monomials(self) -> np.ndarray:
        """∫ ψ(z) for the quadratic basis, (N, M): a row of the least squares is this times the closed-loop operator."""
        row, column = np.triu_indices(self.zz.shape[1])
        return self.zz[:, row, column]


@dataclass(frozen=True, eq=False)
class IntegralLearning:
    """Policy iteration on simulated data; from the game only B, E, Q, R, δ are read, never A.

    For the policies u = -K z, d = L z of the last iteration, their value z'Pz satisfies over every interval
    [z'Pz] - 2 ∫ (u + K z)'B'P z - 2 ∫ (d - L z)'E'P z = -∫ z'(Q + K'RK - δ²L'L) z, whatever u and d were applied
    (Jiang & Jiang 2012; for the game Wu & Luo 2012). P follows by least squares, then K = R⁻¹B'P, L = δ⁻²E'P.
    """

    game: Game
    basis: Basis
    settings: IrlSettings
    seed: int

    @property
    def intervals(self) -> int:
        """N, how many intervals are simulated."""
        given = self.settings.intervals
        return law_settings.enough_for(self.basis.size, 40) if given is None else given

    @cached_property
    def record(self) -> Record:
        """The flight and its integrals. Raises BadInputError when the flight leaves all bounds."""
        s = self.settings
        nodes, quadrature = np.polynomial.legendre.leggauss(NODES)
        within = s.interval * np.concatenate([0.5 * (1.0 + nodes), [1.0]])
        begins = s.interval * np.arange(self.intervals)
        times = np.concatenate([[0.0], (begins[:, None] + within).reshape(-1)])
        with np.errstate(over="ignore", invalid="ignore"):  # refused below
            z, u, d = recording.probing_flight(self.game, self.seed, times, (s.probe, s.disturbance))
            largest = max(float(np.abs(part).max(initial=0.0)) for part in (z, u, d))
        if not largest <= LARGEST_STATE:
            raise BadInputError(
                f"the probing flight of {times[-1]:g} s grows beyond {LARGEST_STATE:g};"
                " make interval, intervals, probe or disturbance smaller"
            )
        if not s.disturbance_measured:
            d = np.zeros_like(d)
        ends = z[:: NODES + 1]
        scales = Stack(ends, ends).channel_scales()
        inside = np.arange(1, len(times)).reshape(self.intervals, NODES + 1)[:, :NODES]
        z, weight = z / scales, 0.5 * s.interval * quadrature

        def integral(left: np.ndarray, right: np.ndarray) -> np.ndarray:
            return np.einsum("q,jqa,jqb->jab", weight, left[inside], right[inside])

        psi = self.basis.psi(ends / scales)
        return Record(
            np.diff(psi, axis=0), integral(z, z), integral(z, u), integral(z, d), (ends / scales)[:-1], scales
        )

    @cached_property
    def target(self) -> Game:
        """The problem that is learned: the game, or its LQ problem."""
        return self.game if self.settings.form == "game" else self.game.with_delta(np.inf)

    @cached_property
    def equations(self) -> StackEquations:
        """Bellman residuals at the simulated states, for the history only: they use A, the learning does not."""
        flown = record(self.target, self.record.states * self.record.scales)
        return StackEquations.build(self.target, self.basis, flown, self.record.scales)

    @property
    def ticks(self) -> int:
        """One policy update each."""
        return self.settings.iterations

    def start(self) -> Memory:
        """W(0); raises BadInputError when the flight is too poor for M weights."""
        weights = law_settings.initial_weights(self.settings.initial_weights, self.basis)
        scaled = weights * self.basis.scaling(self.record.scales)
        if self.intervals < self.basis.size:
            raise BadInputError(
                f"{self.intervals} intervals cannot determine {self.basis.size} weights; record more of them"
            )
        refuse_poor(recording.rank(unit_rows(self.record.monomials)), self.basis.size, "the flight")
        return {"weights": scaled, "misfit": np.array(np.inf)}

    def _least_squares(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows (N, M) and right side (N,) of the equations for the policies of the given scaled weights."""
        data, game = self.record, self.target
        B, E = game.B / data.scales[:, None], game.E / data.scales[:, None]
        P = self.basis.matrix(weights)
        K, L = np.linalg.solve(game.R, B.T @ P), E.T @ P / game.delta**2
        # ∫ z v', v = B (u + K z) + E (d - L z): what the applied policies did beyond the evaluated ones.
        beyond = data.zu @ B.T + data.zz @ (B @ K).T + data.zd @ E.T - data.zz @ (E @ L).T
        row, column = np.triu_indices(game.A.shape[0])
        pushed = beyond[:, row, column] + beyond[:, column, row]
        cost = game.Q * np.outer(data.scales, data.scales) + P @ (B @ K) - P @ (E @ L)
        return data.change - pushed, -np.einsum("jab,ab->j", data.zz, cost)

    def advance(self, tick: int, memory: Memory) -> Memory:
        """One policy evaluation and improvement. Raises NoSolutionError when the numbers break down."""
        with np.errstate(over="ignore", invalid="ignore"):
            rows, right = self._least_squares(memory["weights"])
        if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(right))):
            raise NoSolutionError(
                f"integral learning broke down at iteration {tick + 1}: the policy it evaluates has no value;"
                " start from weights of a stabilizing policy"
            )
        weights = np.linalg.lstsq(rows, right, rcond=0.0)[0]
        misfit = np.linalg.norm(rows @ weights - right) / np.linalg.norm(right)
        return {"weights": weights, "misfit": np.array(misfit)}

    def observe(self, tick: int, memory: Memory) -> Mapping[str, Any]:
        """See `run.Process`; the law's residual is the misfit of the last least squares."""
        return {
            "time": (self.intervals + tick) * self.settings.interval,
            "weights": self.equations.unscaled(memory["weights"]),
            **self.equations.reported_residuals(memory["weights"]),
            "law_residual_norm": float(memory["misfit"]),
        }

    def conclude(self, finished: Run) -> LearningResult:
        """The result of a finished run with its certificates."""
        weights = finished.history["weights"]
        change = np.linalg.norm(np.diff(weights, axis=0), axis=1) / np.linalg.norm(weights[-1])
        late = np.flatnonzero(change > 1e-3)
        diagnostics = {
            "data_time": self.intervals * self.settings.interval,
            "iterations_to_1e-3": float(late[-1] + 2 if len(late) else 1),
        }
        rows, _ = self._least_squares(finished.memory["weights"])
        richness = recording.excitation(rows, self.record.monomials)
        chosen = asdict(self.settings) | {"intervals": self.intervals}
        return conclude("irl", self.target, self.equations, finished.history, richness, chosen, self.seed, diagnostics)


def integral_learning(game: Game, chosen: IrlSettings, seed: int, pool: Stack | None = None) -> IntegralLearning:
    """The baseline on a probing flight of its own, with the quadratic basis; BadInputError for a pool."""
    if pool is not None:
        raise BadInputError("law 'irl' records its own data; give no pool")
    return IntegralLearning(game, basis("quadratic", game.A.shape[0]), chosen, seed)
