"""Off-policy integral reinforcement learning with known B and E, as a user-defined learning law.

The law is the baseline of Section 5.2 of the paper.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from controller.critic.training_run import TrainingRun
from controller.game.basis import Basis, basis
from controller.game.zero_sum import Game
from controller.learning.recording import (
    Stack,
    excitation,
    natural_spread,
    record,
    refuse_poor,
    unit_rows,
)
from controller.learning.ticks import Run
from hfa_support.errors import BadInputError, NoSolutionError
from studies.section5.laws.bellman_equations import StackEquations
from studies.section5.laws.certified import enough_for, initial_weights
from studies.section5.laws.recording import rank
from studies.section5.laws.training import training_run

#: The baseline gain, used before any gain is certified, is the LQR for the game's Q and this
#: multiple of its R.
BASELINE_EFFORT = 100.0
#: Number of Gauss-Legendre nodes in an interval, for which the integrals are exact except for
#: rounding.
NODES = 10
#: Products of larger states would overflow.
LARGEST_STATE = 1e100


@dataclass(frozen=True)
class IrlSettings:
    """Settings of integral reinforcement learning.

    interval: length Δ of an interval, s
    intervals: number N of simulated intervals, at least the number M of weights. None means 40, or
      more if the basis has more than 26 weights (`enough_for`).
    iterations: number of policy updates, one for each Δ after the simulation
    form: "game" (both policies are learned) or "lqr" (1/δ² = 0, the nominal controller)
    initial_weights: W(0) of the first policies in the model's units. With 0, u = 0, which requires
      a stable plant.
    probe: amplitude of the probing inputs
    disturbance: amplitude of the simulated disturbance
    disturbance_measured: whether the learner measures the disturbance
    """

    interval: float = 0.2
    intervals: int | None = None
    iterations: int = 40
    form: str = "game"
    initial_weights: float | tuple[float, ...] = 0.0
    probe: float = 0.05
    disturbance: float = 0.05
    disturbance_measured: bool = True


#: Memory: scaled weights, and the relative misfit of the last least-squares problem.
Memory = dict[str, np.ndarray]


@dataclass(frozen=True, eq=False)
class Record:
    """Data of N intervals of a simulated flight, in coordinates z / scales.

    The integrals are over one interval.

    change: ψ(z(t+Δ)) - ψ(z(t)), (N, M)
    zz: ∫ z z', (N, n, n)
    zu: ∫ z u', (N, n, m)
    zd: ∫ z d', (N, n, k)
    states: z(t), (N, n)
    scales: (n,)
    """

    change: np.ndarray
    zz: np.ndarray
    zu: np.ndarray
    zd: np.ndarray
    states: np.ndarray
    scales: np.ndarray

    @property
    def monomials(self) -> np.ndarray:
        """∫ ψ(z) over each interval for the quadratic basis, (N, M)."""
        row, column = np.triu_indices(self.zz.shape[1])
        return self.zz[:, row, column]


@dataclass(frozen=True, eq=False)
class IntegralLearning:
    """Policy iteration on simulated data.

    The update uses B, E, Q, R and δ. A is used only to simulate the data and to report residuals.
    Over every interval, the value z'Pz of the policies u = -K z and d = L z satisfies

        [z'Pz] - 2 ∫ (u + K z)'B'P z - 2 ∫ (d - L z)'E'P z = -∫ z'(Q + K'RK - δ²L'L) z,

    for any applied u and d (Jiang & Jiang 2012; for the game Wu & Luo 2012). P is computed by least
    squares, and the next policies are K = R⁻¹B'P and L = δ⁻²E'P.

    basis: basis ψ of the value, with M weights
    seed: seed of the probing flight
    """

    game: Game
    basis: Basis
    settings: IrlSettings
    seed: int

    @property
    def intervals(self) -> int:
        """Number N of simulated intervals."""
        given = self.settings.intervals
        return enough_for(self.basis.size, 40) if given is None else given

    @cached_property
    def record(self) -> Record:
        """Data of the simulated flight, with the integrals over each interval.

        Raises BadInputError if the flight grows beyond `LARGEST_STATE`.
        """
        s = self.settings
        nodes, quadrature = np.polynomial.legendre.leggauss(NODES)
        within = s.interval * np.concatenate([0.5 * (1.0 + nodes), [1.0]])
        begins = s.interval * np.arange(self.intervals)
        times = np.concatenate([[0.0], (begins[:, None] + within).reshape(-1)])
        with np.errstate(over="ignore", invalid="ignore"):  # refused below
            z, u, d = probing_flight(self.game, self.seed, times, (s.probe, s.disturbance))
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
        z = z / scales
        weight = 0.5 * s.interval * quadrature

        def integral(left: np.ndarray, right: np.ndarray) -> np.ndarray:
            return np.einsum("q,jqa,jqb->jab", weight, left[inside], right[inside])

        psi = self.basis.psi(ends / scales)
        return Record(
            np.diff(psi, axis=0),
            integral(z, z),
            integral(z, u),
            integral(z, d),
            (ends / scales)[:-1],
            scales,
        )

    @cached_property
    def target(self) -> Game:
        """The problem to learn: the game, or the LQ problem with the game's weights."""
        return self.game if self.settings.form == "game" else self.game.with_delta(np.inf)

    @cached_property
    def equations(self) -> StackEquations:
        """Bellman residuals at the simulated states, for the history only.

        The residuals depend on A, which the learning does not use.
        """
        flown = record(self.target, self.record.states * self.record.scales)
        return StackEquations.build(self.target, self.basis, flown, self.record.scales)

    @property
    def ticks(self) -> int:
        """Number of ticks, one for each policy update."""
        return self.settings.iterations

    def start(self) -> Memory:
        """Return the initial memory with the weights W(0).

        Raises BadInputError if the flight does not determine M weights.
        """
        weights = initial_weights(self.settings.initial_weights, self.basis)
        scaled = weights * self.basis.scaling(self.record.scales)
        if self.intervals < self.basis.size:
            raise BadInputError(
                f"{self.intervals} intervals cannot determine {self.basis.size} weights; increase"
                " intervals"
            )
        refuse_poor(rank(unit_rows(self.record.monomials)), self.basis.size, "the flight")
        return {"weights": scaled, "misfit": np.array(np.inf)}

    def _least_squares(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the matrix (N, M) and the right side (N,) of the least-squares problem for the
        weights.

        weights: scaled weights of the policies to evaluate, (M,)
        """
        data = self.record
        game = self.target
        B = game.B / data.scales[:, None]
        E = game.E / data.scales[:, None]
        P = self.basis.matrix(weights)
        K = np.linalg.solve(game.R, B.T @ P)
        L = E.T @ P / game.delta**2
        # ∫ z v' with v = B (u + K z) + E (d - L z), the difference between applied and evaluated
        # policies.
        beyond = data.zu @ B.T + data.zz @ (B @ K).T + data.zd @ E.T - data.zz @ (E @ L).T
        row, column = np.triu_indices(game.A.shape[0])
        pushed = beyond[:, row, column] + beyond[:, column, row]
        cost = game.Q * np.outer(data.scales, data.scales) + P @ (B @ K) - P @ (E @ L)
        return data.change - pushed, -np.einsum("jab,ab->j", data.zz, cost)

    def advance(self, tick: int, memory: Memory) -> Memory:
        """Return the memory after one policy evaluation and improvement.

        Raises NoSolutionError if the numbers overflow.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            rows, right = self._least_squares(memory["weights"])
        if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(right))):
            raise NoSolutionError(
                f"integral learning broke down at iteration {tick + 1}: the policy it evaluates has"
                " no value; start from weights of a stabilizing policy"
            )
        weights = np.linalg.lstsq(rows, right, rcond=0.0)[0]
        misfit = np.linalg.norm(rows @ weights - right) / np.linalg.norm(right)
        return {"weights": weights, "misfit": np.array(misfit)}

    def observe(self, tick: int, memory: Memory) -> Mapping[str, Any]:
        """Return the quantities to record at this tick."""
        return {
            "time": (self.intervals + tick) * self.settings.interval,
            "weights": self.equations.unscaled(memory["weights"]),
            **self.equations.reported_residuals(memory["weights"]),
        }

    def conclude(self, finished: Run) -> TrainingRun:
        """Return the training run after all ticks."""
        weights = finished.history["weights"]
        change = np.linalg.norm(np.diff(weights, axis=0), axis=1) / np.linalg.norm(weights[-1])
        late = np.flatnonzero(change > 1e-3)
        diagnostics = {
            "data_time": self.intervals * self.settings.interval,
            "iterations_to_1e-3": float(late[-1] + 2 if len(late) else 1),
        }
        return training_run(
            "integral-rl",
            self.target,
            self.equations,
            finished.history,
            excitation(self.record.monomials),
            seed=self.seed,
            diagnostics=diagnostics,
        )


def integral_rl(
    game: Game, chosen: IrlSettings, seed: int, pool: Stack | None = None
) -> IntegralLearning:
    """Return the law on a simulated probing flight, with the quadratic basis.

    chosen: settings of the law
    seed: seed of the probing flight
    pool: None; the data are those of the flight

    Raises BadInputError if a pool is given.
    """
    if pool is not None:
        raise BadInputError("integral-rl records its own flight; leave out the pool")
    return IntegralLearning(game, basis("quadratic", len(game.A)), chosen, seed)


#: Number of sines in each channel. Three in each of m + k channels distinguish the n(n+1)/2
#: products of states. Range of the frequencies, rad/s.
_SINES = 3
_BAND = (0.5, 12.0)


def probing_flight(
    game: Game, seed: int, times: np.ndarray, amplitudes: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return states (N_t, n), inputs (N_t, m) and disturbances (N_t, k) of a probing flight.

    Every channel of u and d is a sum of sines with random phases. The largest possible sums are the
    two amplitudes. z' = A z + B u + E d is simulated as one linear system for [z; w] with w' = Ω w.
    z(0) is random in the box of `natural_spread`, to excite slow modes that the sines do not
    excite.

    times: increasing, (N_t,), s
    amplitudes: of u and of d
    """
    from scipy.linalg import expm

    rng = np.random.default_rng(seed)
    half_widths = natural_spread(game)
    n = game.A.shape[0]
    m = game.B.shape[1]
    k = game.E.shape[1]
    count = _SINES * (m + k)
    frequencies = rng.permutation(np.linspace(*_BAND, count)) * rng.uniform(0.97, 1.03, count)
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    pick = np.zeros((m + k, n + 2 * count))
    waves = np.arange(count)
    pick[waves // _SINES, n + 2 * waves] = (
        np.repeat([amplitudes[0]] * m + [amplitudes[1]] * k, _SINES) / _SINES
    )
    generator = np.zeros((n + 2 * count, n + 2 * count))
    generator[:n, :n] = game.A
    generator[:n] += game.B @ pick[:m] + game.E @ pick[m:]
    generator[n + 2 * waves, n + 2 * waves + 1] = frequencies
    generator[n + 2 * waves + 1, n + 2 * waves] = -frequencies
    sines = np.column_stack([np.cos(phases), np.sin(phases)]).reshape(-1)
    current = np.concatenate([rng.uniform(-half_widths, half_widths), sines])
    rows = []
    steps = np.round(np.diff(times, prepend=0.0), 12)
    exponentials = {step: expm(generator * step) for step in np.unique(steps)}
    for step in steps:
        current = exponentials[step] @ current
        rows.append(current)
    flown = np.array(rows)
    return flown[:, :n], flown @ pick[:m].T, flown @ pick[m:].T


def baseline_value(game: Game) -> np.ndarray:
    """Return the solution P, (n, n), of a Riccati equation with a large weight of the inputs.

        A'P + P A + Q - P B (f R)⁻¹ B'P = 0,   f = BASELINE_EFFORT

    Raises NoSolutionError if (A, B) is not stabilizable.
    """
    from scipy.linalg import solve_continuous_are

    try:
        P: np.ndarray = solve_continuous_are(game.A, game.B, game.Q, BASELINE_EFFORT * game.R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(
            f"no baseline gain: {error}; check that the inputs can stabilize the model"
        ) from error
    return P


def baseline_gain(game: Game) -> np.ndarray:
    """Return the gain K = (f R)⁻¹ B'P, (m, n), with f and P of `baseline_value`."""
    return game.gain(baseline_value(game)) / BASELINE_EFFORT


def baseline_weights(game: Game) -> tuple[float, ...]:
    """Return the weights (M,) of the quadratic basis for a policy with the gain `baseline_gain`."""
    weights = basis("quadratic", len(game.A)).weights(baseline_value(game) / BASELINE_EFFORT)
    return tuple(weights.tolist())
