"""The critic update of the paper, Eq. (46), as printed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from controller.game.basis import Basis, basis
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.laws import law_settings
from controller.laws.certify import conclude
from controller.laws.published_equations import (
    RecordedStack,
    Sample,
    TheoremGains,
    bellman,
    explicit_step_limit,
    normaliser,
    proximal_step,
    theorem_gains,
    update_direction,
)
from controller.laws.run import Memory, Run
from controller.training_data import recording
from controller.training_data.recording import Stack
from controller.training_data.stack_equations import StackEquations
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown

#: Rows of history of a run; the steps between two rows are one tick of the runner.
ROWS = 1000


@dataclass(frozen=True)
class PublishedSettings:
    """Defaults: Section 5.1. Not printed, hence assumed: theta, samples (N_h), basis and normalisation.

    samples, pool_samples: as in `CertifiedSettings`.

    normalisation: "root" n = sqrt(1 + σ'σ) or "squared" n = 1 + σ'σ. stack_policies: "frozen", the policies of
    `recorded_weights` stored with the samples, or "reevaluated" with the current weights. gains: (α₁, α₂), or
    None for those of Theorem 1. integrator: "explicit" (forward Euler) or "proximal" (implicit). coordinates:
    "raw" units of the model or "scaled" by the root mean square of each recorded channel, in which Γ, σ̄ and λ₀ are
    then meant; initial and recorded weights are in the model's units in both. flight_start: z(0) of the flight
    z' = A z + B û that gives the current sample; () learns from the stack alone. gamma: Γ = γ I.
    """

    predefined_time: float = 10.0
    step: float = 1e-4
    eta: float = 0.8
    theta: float = 0.9
    gamma: float = 0.01
    basis: str = "paper"
    samples: int | None = None
    pool_samples: int | None = None
    initial_weights: float | tuple[float, ...] = 100.0
    recorded_weights: float | tuple[float, ...] = 100.0
    normalisation: str = "root"
    stack_policies: str = "frozen"
    gains: tuple[float, float] | None = None
    integrator: str = "explicit"
    coordinates: str = "raw"
    flight_start: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what cannot run, naming the setting."""
        law_settings.recorded(self, "step")
        law_settings.positive("gamma", self.gamma)
        refuse_unknown("normalisation is", self.normalisation, ("root", "squared"))
        refuse_unknown("stack_policies is", self.stack_policies, ("frozen", "reevaluated"))
        refuse_unknown("integrator is", self.integrator, ("explicit", "proximal"))
        refuse_unknown("coordinates is", self.coordinates, ("raw", "scaled"))
        if self.gains is not None and not (len(self.gains) == 2 and all(gain >= 0.0 for gain in self.gains)):
            raise BadInputError(f"gains are {self.gains}; they must be two numbers (alpha1, alpha2) of at least 0")


class FlownState(NamedTuple):
    """The simulated state as a stack of one: ∂ψ (1, M, n), F = A z (1, n) and z'Qz (1,)."""

    gradient: np.ndarray
    drifts: np.ndarray
    costs: np.ndarray


@dataclass(frozen=True, eq=False)
class PublishedLaw:
    """W' = -Γ Σ_{0..N_h} σ̄_j [(α₁+1) sig^(1-η)(ē_j) + (α₂+1) sig^(1+η)(ē_j)], Eq. (46).

    Sample 0 is the current one, with the policies of the current weights; it is there in flight only.
    """

    game: Game
    stack: Stack
    basis: Basis
    settings: PublishedSettings
    seed: int

    @cached_property
    def equations(self) -> StackEquations:
        """The Bellman residuals of the stack in the coordinates of the law."""
        scaled = self.settings.coordinates == "scaled"
        scales = self.stack.channel_scales() if scaled else np.ones(self.game.A.shape[0])
        return StackEquations.build(self.game, self.basis, self.stack, scales)

    @cached_property
    def history(self) -> RecordedStack:
        """The recorded terms of the law."""
        frozen = self.settings.stack_policies == "frozen"
        stored = self._scaled(self.settings.recorded_weights) if frozen else None
        return RecordedStack(self.equations, self.settings.normalisation, stored)

    @cached_property
    def theorem(self) -> TheoremGains:
        """Gains of Theorem 1 for this stack at the initial weights."""
        s = self.settings
        sample = self.history.at(self._initial_weights())
        return theorem_gains(sample.regressors, s.gamma, s.eta, s.theta, s.predefined_time)

    @property
    def gains(self) -> tuple[float, float]:
        """(α₁, α₂) that the law runs with."""
        return self.settings.gains or (self.theorem.alpha1, self.theorem.alpha2)

    @cached_property
    def explicit_step_limit(self) -> float:
        """The largest stable explicit step at the start, with the current sample, s."""
        s, memory = self.settings, self.start()
        sample = self._all_samples(memory["weights"], self._flown(memory["error"]))
        return explicit_step_limit(sample, s.gamma, *self.gains, s.eta)

    @property
    def steps(self) -> int:
        """Integration steps of the whole run."""
        return math.ceil(self.settings.predefined_time / self.settings.step - 1e-9)

    @property
    def ticks(self) -> int:
        """Rows of history after the first."""
        return min(ROWS, self.steps)

    def steps_done(self, tick: int) -> int:
        """Integration steps after `tick` ticks."""
        return tick * self.steps // self.ticks

    def fingerprint(self) -> dict[str, Any]:
        """Everything that decides what the law does, by name."""
        plain = {name: "theorem" if value is None else value for name, value in asdict(self.settings).items()}
        return {
            "law": "published",
            "seed": self.seed,
            "states": self.stack.states,
            "drifts": self.stack.drifts,
            **{f"game.{field.name}": getattr(self.game, field.name) for field in fields(self.game)},
            **{f"settings.{name}": value for name, value in plain.items()},
        }

    def _initial_weights(self) -> np.ndarray:
        return self._scaled(self.settings.initial_weights)

    def _scaled(self, weights: float | tuple[float, ...]) -> np.ndarray:
        return self.equations.scaled(law_settings.initial_weights(weights, self.basis))

    def start(self) -> Memory:
        """W(0) and z(0); raises BadInputError when z(0) has another size."""
        n = self.game.A.shape[0]
        flight = np.array(self.settings.flight_start, dtype=float)
        if len(flight) not in (0, n):
            raise BadInputError(f"flight_start has {len(flight)} numbers; the plant has {n} states")
        return {"weights": self._initial_weights(), "error": flight / self.equations.scales if len(flight) else flight}

    def advance(self, tick: int, memory: Memory) -> Memory:
        """The integration steps of one tick. Raises NoSolutionError when the numbers overflow."""
        weights, error = memory["weights"], memory["error"]
        with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
            for step in range(self.steps_done(tick), self.steps_done(tick + 1)):
                weights, error = self._step(weights, error)
                if not math.isfinite(float(weights @ weights) + float(error @ error)):
                    raise NoSolutionError(self._overflow(step + 1))
        return {"weights": weights, "error": error}

    def _step(self, weights: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s, (alpha1, alpha2), flown = self.settings, self.gains, self._flown(error)
        if s.integrator == "proximal":
            at = self._frozen_normaliser(weights, flown)
            new = proximal_step(at, weights, s.step, s.gamma, alpha1, alpha2, s.eta)
        else:
            slope = update_direction(self._all_samples(weights, flown), s.gamma, alpha1, alpha2, s.eta)
            new = weights + s.step * slope
        if flown is None:
            return new, error
        return new, error + s.step * self._error_rate(weights, flown)

    def _flown(self, error: np.ndarray) -> FlownState | None:
        """The simulated state, None when none is flown."""
        if len(error) == 0:
            return None
        z = error[None, :]
        return FlownState(self.basis.gradient(z), z @ self._plant.T, ((z @ self.equations.Q) * z).sum(axis=-1))

    def _current(self, weights: np.ndarray, flown: FlownState) -> tuple[np.ndarray, np.ndarray]:
        """σ and e of the simulated state."""
        return bellman(*flown, self.equations.S, weights, weights)

    @cached_property
    def _plant(self) -> np.ndarray:
        """A in the coordinates of the law."""
        scales = self.equations.scales
        return self.game.A * scales[None, :] / scales[:, None]

    def _error_rate(self, weights: np.ndarray, flown: FlownState) -> np.ndarray:
        """z' = A z + B û, û = -½ R⁻¹B' ∂ψ'W."""
        gradient = flown.gradient[0].T @ weights
        rate: np.ndarray = flown.drifts[0] - 0.5 * self.equations.S_control @ gradient
        return rate

    def _all_samples(self, weights: np.ndarray, flown: FlownState | None) -> Sample:
        stored = self.history.at(weights)
        if flown is None:
            return stored
        regressors, residuals = self._current(weights, flown)
        n = normaliser(regressors, self.settings.normalisation)
        return Sample(
            np.concatenate([regressors / n[:, None], stored.regressors]),
            np.concatenate([residuals / n, stored.residuals]),
        )

    def _frozen_normaliser(self, weights: np.ndarray, flown: FlownState | None) -> Any:
        """W -> samples with the normaliser of the start of the step, so that ∂ē/∂W = σ̄ within it."""

        def raw(trial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            regressors, residuals = self.history.raw(trial)
            if flown is not None:
                now = self._current(trial, flown)
                regressors, residuals = np.concatenate([now[0], regressors]), np.concatenate([now[1], residuals])
            return regressors, residuals

        n = normaliser(raw(weights)[0], self.settings.normalisation)

        def at(trial: np.ndarray) -> Sample:
            regressors, residuals = raw(trial)
            return Sample(regressors / n[:, None], residuals / n)

        return at

    def _overflow(self, step: int) -> str:
        alpha1, alpha2 = self.gains
        return (
            f"the published law overflowed at step {step} (t = {step * self.settings.step:.3g} s):"
            f" lambda_0 = {self.theorem.lambda_0:.2g}, alpha1 = {alpha1:.2g}, alpha2 = {alpha2:.2g} ask for an"
            f" explicit step below {self.explicit_step_limit:.2g} s, the step is {self.settings.step:g} s;"
            " use law 'certified', or give gains"
        )

    def observe(self, tick: int, memory: Memory) -> Mapping[str, Any]:
        """See `run.Process`."""
        weights = memory["weights"]
        return {
            "time": min(self.steps_done(tick) * self.settings.step, self.settings.predefined_time),
            "weights": self.equations.unscaled(weights),
            **self.equations.reported_residuals(weights),
            "law_residual_norm": float(np.linalg.norm(self.history.at(weights).residuals)),
        }

    def conclude(self, finished: Run) -> LearningResult:
        """The result of a finished run with its certificates."""
        alpha1, alpha2 = self.gains
        diagnostics = {
            "lambda_0": self.theorem.lambda_0,
            "alpha1": alpha1,
            "alpha2": alpha2,
            "explicit_step_limit": self.explicit_step_limit,
        }
        richness = self.equations.excitation(finished.memory["weights"])
        chosen = asdict(self.settings)
        return conclude(
            "published", self.game, self.equations, finished.history, richness, chosen, self.seed, diagnostics
        )


def published_law(game: Game, chosen: PublishedSettings, seed: int, pool: Stack | None = None) -> PublishedLaw:
    """The law on a pool of recorded samples, by default random states; the N_h most different ones are kept."""
    functions = basis(chosen.basis, game.A.shape[0])
    samples, pool_samples = law_settings.sample_counts(chosen.samples, chosen.pool_samples, functions)
    recorded = recording.random_pool(game, pool_samples, seed) if pool is None else pool
    chosen = replace(chosen, samples=samples, pool_samples=pool_samples)
    return PublishedLaw(game, recording.choose(recorded, functions, samples), functions, chosen, seed)
