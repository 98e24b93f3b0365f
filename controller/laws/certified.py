"""The certified law: recorded data to the exact game solution within a predefined time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from controller.game.basis import Basis, basis
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws import law_settings
from controller.laws.certify import conclude
from controller.laws.policy_iteration import (
    Point,
    discount_at,
    iterate,
    lower_discount,
    raise_disturbance,
    stabilizing_step,
)
from controller.laws.refinement import refine
from controller.laws.run import Memory, Run
from controller.laws.scalar_law import after, decay_rate, fraction_to_reach
from controller.training_data import recording
from controller.training_data.recording import Stack
from controller.training_data.stack_equations import GAME, LQ, PartialGame, StackEquations, newton_step

#: A start counts as stabilizing when its margin is at least this fraction of the fastest closed-loop rate.
#: Closer to the edge the regressors are singular to rounding and the first Newton direction is noise.
RELATIVE_MARGIN = 1e-8
#: Margin that the discount leaves, 1/s, beside 1e-6 of the fastest closed-loop rate.
DISCOUNT_MARGIN = 0.5
#: Most sub-steps in one tick, and the fraction of |ē| that a sub-step must fall below for another one.
MOST_SUBSTEPS, STALLED = 50, 0.999
#: A relative residual below this is rounding: the stage has come to rest.
AT_REST = 1e-13


@dataclass(frozen=True)
class CertifiedSettings:
    """predefined_time T_w, tick: s. eta in (0, 1). theta in (0, 1): the share of each stage's time that is used.

    samples: N_h >= M, chosen from a pool of `pool_samples` random states; None stands for 50 of 500, and for more where
    the basis has more than 33 weights (`law_settings.enough_for`). initial_weights: W(0) in the model's units, a number
    for all or (M,).
    """

    predefined_time: float = 10.0
    tick: float = 0.01
    eta: float = 0.8
    theta: float = 0.9
    basis: str = "quadratic"
    samples: int | None = None
    pool_samples: int | None = None
    initial_weights: float | tuple[float, ...] = 100.0

    def __post_init__(self) -> None:
        """Refuse what cannot run, naming the setting."""
        law_settings.recorded(self, "tick")


@dataclass(frozen=True, eq=False)
class CertifiedLaw:
    """Two stages of T = T_w/2 each on the recorded stack (z_j, F_j); from the game only B, E, Q, R, δ are read.

    Stage 1, the LQ problem (1/δ² = 0): W' = -pinv(σ̄) k (|ē|^(1-η) + |ē|^(1+η)) ē/|ē|, k = π/(2 η θ T), with
    the normaliser n_j = sqrt(1 + σ_j'σ_j) of the start of the stage. σ̄W' moves ē along itself, so |ē| obeys the
    scalar law y' = -k (y^(1-η) + y^(1+η)) and is 0 from θT on. In a tick, Newton sub-steps W <- W - f N are taken
    with the f that puts |ē| on the exact scalar value; while it is out of reach, f minimizes |ē|. For f in (0, 1]
    such a step keeps a stabilizing policy stabilizing: with P₁ = P - N the full step and A_f = A - S(P - fN),
    A_f'P₁ + P₁A_f = -Q - (1-f) PSP - f P₁SP₁ - f (P-P₁)S(P-P₁).
    A start that is not stabilizing gets the discount β = its abscissa + margin, i.e. drift F - βz.

    Stage 2: β is lowered to 0, then 1/δ² raised to its value along a clock that ends at T + θT, with Newton
    steps that follow the solution (`policy_iteration`).
    """

    game: Game
    stack: Stack
    drift_misfit: float
    basis: Basis
    settings: CertifiedSettings
    seed: int

    @cached_property
    def equations(self) -> StackEquations:
        """The Bellman residuals of the stack."""
        return StackEquations.build(self.game, self.basis, self.stack, self.stack.channel_scales())

    @property
    def stage_time(self) -> float:
        """T = T_w/2, s."""
        return 0.5 * self.settings.predefined_time

    @property
    def ticks(self) -> int:
        """T_w over the tick, rounded up; the last tick is cut at T_w."""
        return int(np.ceil(self.settings.predefined_time / self.settings.tick - 1e-9))

    def time(self, tick: int) -> float:
        """Time after `tick` ticks, s."""
        return min(tick * self.settings.tick, self.settings.predefined_time)

    def start(self) -> Memory:
        """W(0) with the discount that makes it stabilizing."""
        weights = self.equations.scaled(law_settings.initial_weights(self.settings.initial_weights, self.basis))
        eigenvalues = self.equations.closed_loop_eigenvalues(weights, LQ)
        abscissa, fastest = float(eigenvalues.real.max()), float(np.abs(eigenvalues).max())
        stabilizing = abscissa < 0.0 and -abscissa >= RELATIVE_MARGIN * fastest
        discount = 0.0 if stabilizing else max(0.0, abscissa) + DISCOUNT_MARGIN + 1e-6 * fastest
        here = Point(weights, PartialGame(discount, 0.0), 0)
        return _pack(here, self._normaliser(here), discount)

    def _normaliser(self, here: Point) -> np.ndarray:
        """n_j = sqrt(1 + σ_j'σ_j), (N_h,)."""
        regressors = self.equations.at(here.weights, here.problem).regressors
        return np.sqrt(1.0 + np.sum(regressors**2, axis=1))

    def advance(self, tick: int, memory: Memory) -> Memory:
        """One tick: stage 1 up to T, stage 2 after it; a tick that holds T does both."""
        begin, end, T = self.time(tick), self.time(tick + 1), self.stage_time
        here, normaliser, first_discount = _unpack(memory)
        if begin < self.settings.theta * T:
            here = self._stage_one(here, normaliser, begin, end)
            if end >= self.settings.theta * T:
                normaliser = self._normaliser(here)
        if end > T and here.problem != GAME:
            here = self._stage_two(here, normaliser, first_discount, (end - T) / (self.settings.theta * T))
        return _pack(here, normaliser, first_discount)

    def _stage_one(self, here: Point, normaliser: np.ndarray, begin: float, end: float) -> Point:
        s = self.settings
        residual = self._law_residual(here, normaliser)
        rate = decay_rate(self.stage_time, s.eta, s.theta)
        target = after(residual, rate, s.eta, end - begin) if end < s.theta * self.stage_time else 0.0
        if target > 0.0:
            return self._descend(here, normaliser, target)
        if self.equations.at(here.weights, here.problem).relative <= AT_REST:
            return here
        return iterate(self.equations, here, normaliser, to_the_floor=True)[0]

    def _law_residual(self, here: Point, normaliser: np.ndarray) -> float:
        """|ē| of the problem that is being solved now."""
        return float(np.linalg.norm(self.equations.at(here.weights, here.problem).residuals / normaliser))

    def _descend(self, here: Point, normaliser: np.ndarray, target: float) -> Point:
        """Newton sub-steps until |ē| is at its target, or no longer falls (noisy data have a floor)."""
        last = np.inf
        for _ in range(MOST_SUBSTEPS):
            found = self.equations.at(here.weights, here.problem)
            residuals = found.residuals / normaliser
            size = float(np.linalg.norm(residuals))
            if size <= target * (1.0 + 1e-9) or size > STALLED * last:
                break
            last = size
            step = newton_step(found, normaliser)
            linear, quadratic = self.equations.along_step(here.weights, step, found, here.problem)
            fraction = fraction_to_reach(residuals, linear / normaliser, quadratic / normaliser, target)
            here = stabilizing_step(self.equations, here, step, fraction)
        return here

    def _stage_two(self, here: Point, normaliser: np.ndarray, first_discount: float, clock: float) -> Point:
        """Follow the ramp to its state at `clock` (1 at the end): half of it for β when there is one, then 1/δ²."""
        clock = 1.0 if clock >= 1.0 - 1e-12 else clock
        split = 0.5 if first_discount > 0.0 else 0.0
        if here.problem.discount > 0.0:
            lower = discount_at(min(1.0, clock / split), first_discount)
            here = lower_discount(self.equations, here, lower, normaliser)
        if clock > split:
            share = (clock - split) / (1.0 - split)
            here = raise_disturbance(self.equations, here, share, normaliser, self.game.delta)
        if clock == 1.0:
            here = self._refined(iterate(self.equations, here, normaliser, to_the_floor=True)[0])
        return here

    def _refined(self, here: Point) -> Point:
        """The quadratic weights with the last digits, which the rounding of single samples hides.

        Where P is large in one direction, a sample shows the other ones as a small difference; the entries of the
        Riccati equation of the drifts' linear fit show each by itself.
        """
        e = self.equations
        P, solves = refine(e.drift_matrix, e.control, e.disturbance, e.Q, e.basis.matrix(here.weights))
        beyond = here.weights[e.basis.quadratic_size :]
        weights = np.concatenate([e.basis.weights(P)[: e.basis.quadratic_size], beyond])
        return here._replace(weights=weights, solves=here.solves + solves)

    def observe(self, tick: int, memory: Memory) -> Mapping[str, Any]:
        """See `run.Process`."""
        here, normaliser, _ = _unpack(memory)
        return {
            "time": self.time(tick),
            "weights": self.equations.unscaled(here.weights),
            **self.equations.reported_residuals(here.weights),
            "law_residual_norm": self._law_residual(here, normaliser),
            "solves": here.solves,
        }

    def conclude(self, finished: Run) -> LearningResult:
        """The result of a finished run with its certificates."""
        history = finished.history
        here, _, first_discount = _unpack(finished.memory)
        diagnostics = {
            "discount_at_start": first_discount,
            "drift_misfit": self.drift_misfit,
            "linear_solves": float(history["solves"][-1]),
            "most_linear_solves_in_one_recorded_tick": float(np.diff(history["solves"], prepend=0).max()),
        }
        richness = self.equations.excitation(here.weights)
        chosen = asdict(self.settings)
        return conclude("certified", self.game, self.equations, history, richness, chosen, self.seed, diagnostics)


def certified_law(game: Game, chosen: CertifiedSettings, seed: int, pool: Stack | None = None) -> CertifiedLaw:
    """The law on a pool of recorded samples, by default random states (`recording.random_pool`).

    The drifts are replaced by their linear fit over the whole pool: the game is on a linear plant, so exact
    drifts stay as they are, and noise of relative size ε in 500 samples moves P by about ε instead of tens of ε.
    Of the pool the `samples` most different ones are kept. Raises BadInputError when the pool has not rank M.
    """
    functions = basis(chosen.basis, game.A.shape[0])
    samples, pool_samples = law_settings.sample_counts(chosen.samples, chosen.pool_samples, functions)
    recorded = recording.random_pool(game, pool_samples, seed) if pool is None else pool
    fitted, misfit = recorded.linear()
    chosen = replace(chosen, samples=samples, pool_samples=pool_samples)
    return CertifiedLaw(game, recording.choose(fitted, functions, samples), misfit, functions, chosen, seed)


def _pack(here: Point, normaliser: np.ndarray, first_discount: float) -> Memory:
    return {
        "weights": here.weights,
        "problem": np.array(here.problem),
        "solves": np.array(here.solves),
        "normaliser": normaliser,
        "first_discount": np.array(first_discount),
    }


def _unpack(memory: Memory) -> tuple[Point, np.ndarray, float]:
    discount, share = (float(value) for value in memory["problem"])
    here = Point(memory["weights"], PartialGame(discount, share), int(memory["solves"]))
    return here, memory["normaliser"], float(memory["first_discount"])
