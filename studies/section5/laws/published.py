"""The critic update of the paper, Eq. (46), the gains of Theorem 1, and the largest stable step.

The module is also an example of a user-defined learning law. Such a law is an object with `ticks`,
`start`, `advance` and `observe`, which `controller.run` calls. `conclude` converts the final
weights to P and K with certificates.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from controller.critic.training_run import TrainingRun
from controller.game.basis import Basis, basis
from controller.game.zero_sum import Game
from controller.hfa_game import ordinary_deviations
from controller.learning.recording import Stack, random_pool
from controller.learning.ticks import Run
from hfa_support.errors import BadInputError, NoSolutionError
from studies.section5.laws.bellman_equations import StackEquations
from studies.section5.laws.recording import choose
from studies.section5.laws.training import training_run

#: Largest number of history rows. The steps between two rows are one tick.
ROWS = 1000
#: Smallest residual in the curvature, which is infinite at 0. TINY avoids a division by 0.
CURVATURE_FLOOR = 1e-14
TINY = float(np.finfo(float).tiny)
#: Largest number of Newton steps in an implicit step, and relative step at convergence.
MOST_STEPS = 60
SETTLED = 1e-10
_WORDS = {
    "normalisation": ("root", "squared"),
    "stack_policies": ("frozen", "reevaluated"),
    "integrator": ("explicit", "proximal"),
    "coordinates": ("raw", "scaled"),
    "drift": ("with reference", "error"),
}


@dataclass(frozen=True)
class PublishedSettings:
    """Settings of the update law. The defaults are those of Section 5.1.

    The paper does not print theta, samples, basis and normalization. They are assumed.

    predefined_time: T_w, s
    step: integration step, s
    eta, theta: η and θ of Theorem 1
    gamma: γ in Γ = γ I
    basis: name of the basis ψ
    samples: number N_h of recorded samples, the most different ones of `pool_samples` random states
    box: half-widths of the box of these states, or () for the typical deviations of the paper's
      aircraft, and for another plant those of `natural_spread`
    initial_weights: W(0), or one number for all weights
    recorded_weights: weights of the policies stored with the samples, or one number for all weights
    normalisation: "root", n = sqrt(1 + σ'σ), or "squared", n = 1 + σ'σ
    stack_policies: "frozen" for the policies of `recorded_weights`, stored with the samples, or
      "reevaluated" for the policies of the current weights
    gains: (α₁, α₂), or None for the gains of Theorem 1
    integrator: "explicit" (forward Euler) or "proximal" (implicit)
    drift: in a flight that tracks a reference x_d, "with reference" for F = A x - x_d' as the paper
      defines it, or "error" for F = A z
    coordinates: "raw" for the units of the model, or "scaled" by the root mean square of each
      recorded channel. Γ, σ̄ and λ₀ refer to these coordinates. Initial and recorded weights are in
      the model's units in both cases.
    flight_start: z(0) of the flight z' = A z + B û that supplies the current sample, for explicit
      steps, or () to learn from the recorded samples alone
    """

    predefined_time: float = 10.0
    step: float = 1e-4
    eta: float = 0.8
    theta: float = 0.9
    gamma: float = 0.01
    basis: str = "paper"
    samples: int = 50
    pool_samples: int = 500
    box: tuple[float, ...] = ()
    initial_weights: float | tuple[float, ...] = 100.0
    recorded_weights: float | tuple[float, ...] = 100.0
    normalisation: str = "root"
    stack_policies: str = "frozen"
    gains: tuple[float, float] | None = None
    integrator: str = "explicit"
    drift: str = "with reference"
    coordinates: str = "raw"
    flight_start: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        """Raise BadInputError for an unknown word, or for a flight with implicit steps."""
        for name, words in _WORDS.items():
            if getattr(self, name) not in words:
                raise BadInputError(
                    f"{name} is {getattr(self, name)!r}; choose from {', '.join(words)}"
                )
        if self.integrator == "proximal" and self.flight_start:
            raise BadInputError(
                "flight_start needs integrator 'explicit'; implicit steps learn from the stack"
                " alone"
            )


class Sample(NamedTuple):
    """Normalized samples: regressors σ̄_j = σ_j/n_j, (N, M), and residuals ē_j = e_j/n_j, (N,)."""

    regressors: np.ndarray
    residuals: np.ndarray


class TheoremGains(NamedTuple):
    """Gains of Theorem 1.

    lambda_0: smallest eigenvalue of Σ_j σ̄_j σ̄_j'
    c1, c2, alpha1, alpha2: Eq. (48)-(49)
    """

    lambda_0: float
    c1: float
    c2: float
    alpha1: float
    alpha2: float


def normaliser(regressors: np.ndarray, kind: str) -> np.ndarray:
    """Return the normalization n_j = 1 + σ'σ ("squared") or sqrt(1 + σ'σ) ("root"), (N,).

    The paper does not state which of the two is used.
    """
    squared = 1.0 + (regressors**2).sum(axis=-1)
    return squared if kind == "squared" else np.sqrt(squared)


def bellman(
    gradient: np.ndarray,
    drifts: np.ndarray,
    costs: np.ndarray,
    S: np.ndarray,
    weights: np.ndarray,
    policy: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the regressors and Bellman residuals of samples, Eq. 32-33.

        σ_j = ∂ψ_j (F_j + B û_j + E d̂_j), (N, M)
        e_j = W'σ_j + z'Qz + û'Rû - δ²d̂'d̂, (N,)

    The policies are those of the weights W_p: B û + E d̂ = -½ S ∂ψ'W_p, and their cost is
    ¼ (∂ψ'W_p)' S (∂ψ'W_p).

    gradient: ∂ψ_j, (N, M, n)
    drifts: F_j, (N, n)
    costs: z'Qz, (N,)
    S: (n, n)
    weights: W, (M,)
    policy: W_p, (M,)
    """
    value_gradient = policy @ gradient
    pushed = value_gradient @ S
    regressors = (gradient @ (drifts - 0.5 * pushed)[..., None])[..., 0]
    return regressors, regressors @ weights + costs + 0.25 * (pushed * value_gradient).sum(axis=-1)


def theorem_gains(
    regressors: np.ndarray, gamma: float, eta: float, theta: float, T_w: float
) -> TheoremGains:
    """Return the gains of Theorem 1 (Eq. 48-49).

        c₁ = (2γλ₀)^(1-η/2),  c₂ = N_h^(-η/2) (2γλ₀)^(1+η/2),  α_i = π / (θ T η c_i),  T = T_w/2

    λ₀ is the smallest eigenvalue of Σ_j σ̄_j σ̄_j'. If λ₀ is 0, α_i is inf.

    regressors: σ̄_j, (N_h, M)
    """
    lambda_0 = float(np.linalg.svd(regressors, compute_uv=False)[-1] ** 2)
    c1 = math.pow(2.0 * gamma * lambda_0, 1.0 - eta / 2.0)
    c2 = len(regressors) ** (-eta / 2.0) * math.pow(2.0 * gamma * lambda_0, 1.0 + eta / 2.0)
    rate = math.pi / (theta * 0.5 * T_w * eta)
    return TheoremGains(lambda_0, c1, c2, *(rate / c if c > 0.0 else math.inf for c in (c1, c2)))


def signed_powers(residuals: np.ndarray, alpha1: float, alpha2: float, eta: float) -> np.ndarray:
    """Return (α₁+1) sig^(1-η)(ē) + (α₂+1) sig^(1+η)(ē), where sig^p(x) = |x|^p sign(x).

    residuals: ē
    """
    magnitude = np.abs(residuals)
    low = magnitude ** (1.0 - eta)
    # |e|^(1+η) = |e|² / |e|^(1-η) costs no second power; at 0 both are 0.
    high = magnitude * magnitude / np.maximum(low, TINY)
    result: np.ndarray = np.copysign((alpha1 + 1.0) * low + (alpha2 + 1.0) * high, residuals)
    return result


def update_direction(
    sample: Sample, gamma: float, alpha1: float, alpha2: float, eta: float
) -> np.ndarray:
    """Return the right side of Eq. (46) for the given samples, (M,).

    -γ Σ_j σ̄_j [(α₁+1) sig^(1-η)(ē_j) + (α₂+1) sig^(1+η)(ē_j)]
    """
    return -gamma * (signed_powers(sample.residuals, alpha1, alpha2, eta) @ sample.regressors)


def explicit_step_limit(
    sample: Sample, gamma: float, alpha1: float, alpha2: float, eta: float
) -> float:
    """Return the largest stable step of explicit Euler for Eq. (46) at the current weights, s.

    The limit is 2 / λ_max(γ Σ_j c_j σ̄_j σ̄_j'), where c_j is the slope of `signed_powers` at ē_j.
    The limit approaches 0 if any residual approaches 0, and is inf if all regressors are 0.
    """
    size = np.maximum(np.abs(sample.residuals), TINY)
    slopes = (alpha1 + 1.0) * (1.0 - eta) * size**-eta + (alpha2 + 1.0) * (1.0 + eta) * size**eta
    with np.errstate(over="ignore"):
        fastest = (
            gamma * float(np.linalg.norm(np.sqrt(slopes)[:, None] * sample.regressors, 2)) ** 2
        )
    return 2.0 / fastest if fastest > 0.0 else math.inf


def proximal_step(
    at: Callable[[np.ndarray], Sample],
    weights: np.ndarray,
    step: float,
    gamma: float,
    alpha1: float,
    alpha2: float,
    eta: float,
) -> np.ndarray:
    """Return the weights W after an implicit step h of Eq. (46).

    W minimizes

        |W - W_k|²/(2γh) + Σ_j (α₁+1)|ē_j|^(2-η)/(2-η) + (α₂+1)|ē_j|^(2+η)/(2+η).

    The method is Gauss-Newton with a backtracking line search and an upper bound on the curvature
    of |ē|^(2-η). The result contains nan if the powers overflow.

    at: function W -> Sample, with ∂ē/∂W = σ̄
    weights: W_k
    step: h, s
    """

    def tried(trial: np.ndarray) -> tuple[float, Sample]:
        sample = at(trial)
        magnitude = np.abs(sample.residuals)
        powers = (alpha1 + 1.0) * magnitude ** (2.0 - eta) / (2.0 - eta)
        powers = powers + (alpha2 + 1.0) * magnitude ** (2.0 + eta) / (2.0 + eta)
        return float(((trial - weights) ** 2).sum() / (2.0 * gamma * step) + powers.sum()), sample

    inertia = 1.0 / np.sqrt(gamma * step)
    current = weights
    value, sample = tried(weights)
    for _ in range(MOST_STEPS):
        push = signed_powers(sample.residuals, alpha1, alpha2, eta)
        magnitude = np.maximum(np.abs(sample.residuals), CURVATURE_FLOOR)
        root = np.sqrt(
            (alpha1 + 1.0) * magnitude**-eta + (alpha2 + 1.0) * (1.0 + eta) * magnitude**eta
        )
        rows = np.vstack([root[:, None] * sample.regressors, inertia * np.eye(len(weights))])
        right = np.concatenate([-push / root, -inertia * (current - weights)])
        if not (np.all(np.isfinite(rows)) and np.all(np.isfinite(right)) and np.isfinite(value)):
            return np.full_like(weights, np.nan)
        orthogonal, triangular = np.linalg.qr(rows)
        direction = np.linalg.solve(triangular, orthogonal.T @ right)
        fraction = 1.0
        while (found := tried(current + fraction * direction))[0] > value and fraction > 1e-12:
            fraction *= 0.5
        if not found[0] <= value:
            return current
        current = current + fraction * direction
        value, sample = found
        if fraction * np.linalg.norm(direction) <= SETTLED * (1.0 + np.linalg.norm(current)):
            return current
    return current


@dataclass(frozen=True, eq=False)
class PublishedLaw:
    """Law W' = -Γ Σ_{0..N_h} σ̄_j [(α₁+1) sig^(1-η)(ē_j) + (α₂+1) sig^(1+η)(ē_j)], Eq. (46).

    The law is run by `controller.run`. Sample 0 is the current state with the policies of the
    current weights, and exists only in flight.

    stack: recorded samples, states z_j and drifts F_j
    basis: basis ψ, with M weights
    seed: seed of the recorded samples
    name: name of the law
    """

    game: Game
    stack: Stack
    basis: Basis
    settings: PublishedSettings
    seed: int
    name: str = "published"

    @cached_property
    def equations(self) -> StackEquations:
        """The recorded samples in the coordinates of the law."""
        scaled = self.settings.coordinates == "scaled"
        scales = self.stack.channel_scales() if scaled else np.ones(self.game.A.shape[0])
        return StackEquations.build(self.game, self.basis, self.stack, scales)

    @cached_property
    def _S_control(self) -> np.ndarray:
        """S_u = B R⁻¹ B' in the coordinates of the law, (n, n)."""
        return self.game.S_control / np.outer(self.equations.scales, self.equations.scales)

    @cached_property
    def S(self) -> np.ndarray:
        """S = S_u - S_d/δ² in the coordinates of the law, (n, n)."""
        outer = np.outer(self.equations.scales, self.equations.scales)
        return self._S_control - self.game.S_disturbance / self.game.delta**2 / outer

    @cached_property
    def _costs(self) -> np.ndarray:
        """z'Qz of the recorded samples, (N_h,)."""
        e = self.equations
        return np.sum((e.states @ e.Q) * e.states, axis=-1)

    @cached_property
    def _stored(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Recorded samples with the stored policies: σ_j, cost, n_j and σ̄_j = σ_j/n_j.

        These values do not depend on the current weights.
        """
        e = self.equations
        policy = self._scaled(self.settings.recorded_weights)
        regressors, costs = bellman(
            e.gradient, e.drifts, self._costs, self.S, np.zeros(e.basis.size), policy
        )
        n = normaliser(regressors, self.settings.normalisation)
        return regressors, costs, n, regressors / n[:, None]

    def terms(self, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the regressors σ_j, (N_h, M), and residuals e_j, (N_h,), of the recorded samples.

        As in the paper, the stored policies are used by default. The fixed point of the update is
        then the value of these policies and not that of the game.
        """
        if self.settings.stack_policies == "reevaluated":
            e = self.equations
            return bellman(e.gradient, e.drifts, self._costs, self.S, weights, weights)
        regressors, costs, *_ = self._stored
        return regressors, regressors @ weights + costs

    def recorded(self, weights: np.ndarray) -> Sample:
        """Return the normalized recorded samples at the current weights."""
        regressors, residuals = self.terms(weights)
        if self.settings.stack_policies == "reevaluated":
            return self._normalised(regressors, residuals)
        *_, n, normalised = self._stored
        return Sample(normalised, residuals / n)

    def _normalised(self, regressors: np.ndarray, residuals: np.ndarray) -> Sample:
        n = normaliser(regressors, self.settings.normalisation)
        return Sample(regressors / n[:, None], residuals / n)

    def _all_samples(self, weights: np.ndarray, error: np.ndarray) -> Sample:
        """Return the current sample (only in flight) and the recorded samples.

        error: z of the flight, empty without a flight
        """
        stored = self.recorded(weights)
        e = self.equations
        if len(error) == 0:
            return stored
        z = error[None, :]
        costs = ((z @ e.Q) * z).sum(axis=-1)
        now = self._normalised(
            *bellman(self.basis.gradient(z), z @ self._plant.T, costs, self.S, weights, weights)
        )
        return Sample(*(np.concatenate(pair) for pair in zip(now, stored, strict=True)))

    @cached_property
    def _plant(self) -> np.ndarray:
        """A in the coordinates of the law, (n, n)."""
        scales = self.equations.scales
        return self.game.A * scales[None, :] / scales[:, None]

    @cached_property
    def theorem(self) -> TheoremGains:
        """Gains of Theorem 1 for the recorded samples at the initial weights."""
        s = self.settings
        sample = self.recorded(self._scaled(s.initial_weights))
        return theorem_gains(sample.regressors, s.gamma, s.eta, s.theta, s.predefined_time)

    @property
    def gains(self) -> tuple[float, float]:
        """(α₁, α₂), from the settings or from Theorem 1."""
        return self.settings.gains or (self.theorem.alpha1, self.theorem.alpha2)

    @cached_property
    def explicit_step_limit(self) -> float:
        """Largest stable explicit step at the initial weights, s.

        In flight, the current sample is included.
        """
        sample = self._all_samples(*self.start().values())
        return explicit_step_limit(sample, self.settings.gamma, *self.gains, self.settings.eta)

    @property
    def facts(self) -> dict[str, float]:
        """λ₀, the gains α₁ and α₂, and the largest stable explicit step, at the initial weights."""
        alpha1, alpha2 = self.gains
        named = {"lambda_0": self.theorem.lambda_0, "alpha1": alpha1, "alpha2": alpha2}
        return named | {"explicit_step_limit": self.explicit_step_limit}

    def _scaled(self, weights: float | tuple[float, ...]) -> np.ndarray:
        return self.equations.scaled(
            np.broadcast_to(np.array(weights, dtype=float), self.basis.size)
        )

    @property
    def _steps(self) -> int:
        return math.ceil(self.settings.predefined_time / self.settings.step - 1e-9)

    def steps_done(self, tick: int) -> int:
        """Return the number of integration steps before a tick."""
        return tick * self._steps // self.ticks

    # The four members that `controller.run` uses.

    @property
    def ticks(self) -> int:
        """Number of ticks. The history has a row for each tick, after a first row for the
        initial values.
        """
        return min(ROWS, self._steps)

    def start(self) -> dict[str, np.ndarray]:
        """Return the initial memory, W(0) and z(0), in the coordinates of the law."""
        flight = np.array(self.settings.flight_start, dtype=float)
        error = flight / self.equations.scales if len(flight) else flight
        return {"weights": self._scaled(self.settings.initial_weights), "error": error}

    def advance(self, tick: int, memory: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Return the memory after the integration steps of one tick.

        Raises NoSolutionError if the numbers overflow.
        """
        weights = memory["weights"]
        error = memory["error"]
        with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
            for step in range(self.steps_done(tick), self.steps_done(tick + 1)):
                weights, error = self._step(weights, error)
                if not math.isfinite(float(weights @ weights) + float(error @ error)):
                    raise NoSolutionError(self.overflow(step + 1))
        return {"weights": weights, "error": error}

    def observe(self, tick: int, memory: dict[str, np.ndarray]) -> Mapping[str, Any]:
        """Return the quantities to record after `tick` ticks."""
        weights = memory["weights"]
        return {
            "time": min(self.steps_done(tick) * self.settings.step, self.settings.predefined_time),
            "weights": self.equations.unscaled(weights),
            **self.equations.reported_residuals(weights),
        }

    def _step(self, weights: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s = self.settings
        gains = self.gains
        if s.integrator == "proximal":
            # The normalization is that at the start of the step, so that ∂ē/∂W = σ̄.
            n = normaliser(self.terms(weights)[0], s.normalisation)

            def at(trial: np.ndarray) -> Sample:
                regressors, residuals = self.terms(trial)
                return Sample(regressors / n[:, None], residuals / n)

            return proximal_step(at, weights, s.step, s.gamma, *gains, s.eta), error
        new = weights + s.step * update_direction(
            self._all_samples(weights, error), s.gamma, *gains, s.eta
        )
        if len(error) == 0:
            return new, error
        value_gradient = self.basis.gradient(error[None, :])[0].T @ weights
        rate = (error[None, :] @ self._plant.T)[0] - 0.5 * self._S_control @ value_gradient
        return new, error + s.step * rate

    def overflow(self, step: int) -> str:
        """Return the message for numbers that overflow at an integration step."""
        return (
            f"the {self.name} law overflowed at step {step}"
            f" (t = {step * self.settings.step:.3g} s):"
            " lambda_0 = {lambda_0:.2g}, alpha1 = {alpha1:.2g}, alpha2 = {alpha2:.2g} ask"
            " for an explicit step below {explicit_step_limit:.2g} s,".format(**self.facts)
            + f" the step is {self.settings.step:g} s; give gains"
        )

    def conclude(self, finished: Run) -> TrainingRun:
        """Return the training run after all ticks."""
        return training_run(
            self.name,
            self.game,
            self.equations,
            finished.history,
            self.equations.excitation,
            seed=self.seed,
            diagnostics=self.facts,
        )


#: Weight of every state in the LQ problem whose solution is the start of the modified law.
START_Q = 1000.0


@dataclass(frozen=True)
class ModifiedSettings(PublishedSettings):
    """Settings with which the update law stays bounded: gains by hand, scaled states, a quadratic
    basis, drifts of the error, and a start that stabilizes (`stabilizing_weights`), unless other
    weights are given.
    """

    basis: str = "quadratic"
    gains: tuple[float, float] | None = (100.0, 100.0)
    coordinates: str = "scaled"
    drift: str = "error"
    initial_weights: float | tuple[float, ...] | None = None  # type: ignore[assignment]
    recorded_weights: float | tuple[float, ...] | None = None  # type: ignore[assignment]


def stabilizing_weights(game: Game, functions: Basis) -> tuple[float, ...]:
    """Return the weights (M,) of the solution of the LQ problem with Q = `START_Q` I.

    Raises NoSolutionError if (A, B) is not stabilizable.
    """
    from scipy.linalg import solve_continuous_are

    try:
        P = solve_continuous_are(game.A, game.B, START_Q * np.eye(len(game.A)), game.R)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(
            f"no stabilizing start: {error}; check that the inputs can stabilize the model"
        ) from error
    return tuple(functions.weights(P).tolist())


def modified_law(
    game: Game, chosen: ModifiedSettings, seed: int, pool: Stack | None = None
) -> PublishedLaw:
    """Return the law of Eq. (46) with the modifications that keep its weights bounded.

    chosen, seed, pool: as for `published_law`
    """
    start = stabilizing_weights(game, basis(chosen.basis, len(game.A)))
    first = start if chosen.initial_weights is None else chosen.initial_weights
    stored = start if chosen.recorded_weights is None else chosen.recorded_weights
    settings = replace(chosen, initial_weights=first, recorded_weights=stored)
    law = published_law(game, settings, seed, pool)
    return replace(law, name="modified")


def published_law(
    game: Game, chosen: PublishedSettings, seed: int, pool: Stack | None = None
) -> PublishedLaw:
    """Return the law of Eq. (46) for a game, with recorded samples selected from a pool.

    chosen: settings of the law
    seed: seed of the random states
    pool: candidates for the recorded samples, or None for random states
    """
    functions = basis(chosen.basis, game.A.shape[0])
    recorded = pool
    if recorded is None:
        widths = np.array(chosen.box) if chosen.box else ordinary_deviations(game.names)
        recorded = random_pool(game, chosen.pool_samples, seed, widths)
    return PublishedLaw(game, choose(recorded, functions, chosen.samples), functions, chosen, seed)
