"""Certified learning law: the exact game solution from recorded data within a predefined time.

Newton (policy-iteration) steps on the recorded samples lead from the discounted LQ problem to the
game. The discount is lowered to 0 first, and then 1/δ² is raised from 0. In the LQ stage the scalar
law y' = -k (y^(1-η) + y^(1+η)) makes the residual vanish by a predefined time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from controller.critic.training_run import TrainingRun
from controller.game.basis import Basis, basis
from controller.game.zero_sum import Game
from controller.learning.recording import Stack, random_pool
from controller.learning.ticks import Run
from hfa_support.errors import (
    BadInputError,
    NoSolutionError,
    refuse_unless_positive,
)
from hfa_support.matrices import checked_matrix
from studies.section5.laws.bellman_equations import (
    GAME,
    LQ,
    PartialGame,
    Riccati,
    StackEquations,
    newton_step,
)
from studies.section5.laws.recording import choose
from studies.section5.laws.training import training_run


def decay_rate(time: float, eta: float, theta: float) -> float:
    """Return the rate k = π / (2 η θ T), 1/s, for convergence by the time θT.

    With this k, y' = -k (y^(1-η) + y^(1+η)) reaches 0 by θT from any y(0) >= 0.

    time: T, s
    eta: η in (0, 1)
    theta: θ in (0, 1)
    """
    return math.pi / (2.0 * eta * theta * time)


def after(y: float, rate: float, eta: float, step: float) -> float:
    """Return the exact solution y of y' = -rate (y^(1-η) + y^(1+η)) after `step` seconds.

    x = y^η satisfies x' = -η rate (1 + x²). Therefore the result is tan(max(0, atan(y^η) - η rate
    step))^(1/η).

    y: initial value, >= 0
    rate: 1/s
    eta: η in (0, 1)
    step: s
    """
    return math.tan(max(0.0, math.atan(y**eta) - eta * rate * step)) ** (1.0 / eta)


def fraction_to_reach(
    constant: np.ndarray, linear: np.ndarray, quadratic: np.ndarray, target: float
) -> float:
    """Return the fraction f in (0, 1] of a Newton step that gives the residuals the norm `target`.

    The residuals after the step are r(f) = constant + f linear + f² quadratic. The result is the
    smallest f with |r(f)| = target. If no such f exists, or if the target is 0, the result is the f
    with the smallest |r(f)| among f = 1 and the stationary points of |r(f)| in (0, 1] (Benner and
    Byers 1998).

    constant, linear, quadratic: (N_h,)
    """
    square = np.array(
        [
            quadratic @ quadratic,
            2.0 * linear @ quadratic,
            linear @ linear + 2.0 * constant @ quadratic,
            2.0 * constant @ linear,
            constant @ constant,
        ]
    )
    reached = (
        _roots_in_unit_interval(square - np.array([0.0, 0.0, 0.0, 0.0, target**2]))
        if target > 0.0
        else []
    )
    if reached:
        return reached[0]
    lowest = min(
        [1.0, *_roots_in_unit_interval(np.polyder(square))],
        key=lambda f: float(np.polyval(square, f)),
    )
    return lowest


def _roots_in_unit_interval(polynomial: np.ndarray) -> list[float]:
    """Return the real roots of a polynomial in (0, 1], ascending, or [] if a coefficient is not
    finite.

    polynomial: coefficients (k,), highest power first
    """
    reversed_ = polynomial[::-1] / np.abs(polynomial).max()
    if not np.all(np.isfinite(reversed_)):
        return []
    inverse = np.roots(reversed_)
    real = inverse.real[np.abs(inverse.imag) <= 1e-9 * np.abs(inverse)]
    return sorted(1.0 / float(root) for root in real if root >= 1.0)


#: A Newton correction below this fraction of |W| ends an intermediate iteration; the next
#: correction would be about its square.
TRACKING = 1e-5
#: A correction below this fraction of |W| that no longer halves is rounding, or noise in the data.
SETTLED = 1e-6
#: Largest number of halvings of a step that loses stability.
MOST_HALVINGS = 30
#: Smallest relative step of β and of the share of 1/δ². If it does not succeed, there is no
#: solution beyond.
SMALLEST_STEP = 1e-9
#: If a first step of the share fails even at this size, no plant would succeed.
NO_STEP = 1e-30


class Point(NamedTuple):
    """Weights at one step of the learning, and the auxiliary problem of this step.

    weights: (M,), in scaled coordinates
    problem: discount and share
    """

    weights: np.ndarray
    problem: PartialGame


def iterate(
    equations: StackEquations,
    here: Point,
    normaliser: np.ndarray,
    *,
    to_the_floor: bool,
    most: int = 100,
) -> tuple[Point, bool]:
    """Return the point after repeated Newton steps W <- W - N for one problem, and whether they
    converged.

    The steps of an LQ problem (share 0) are shortened by `stabilizing_step` where needed (Kleinman
    1968). A singular or infinite step ends the iteration without convergence.

    equations: Bellman residuals of the recorded samples
    here: initial weights, and the problem
    normaliser: as for `newton_step`
    to_the_floor: True to continue until the correction no longer halves; False to stop at the
        relative correction `TRACKING`
    most: largest number of steps

    Raises NoSolutionError if `stabilizing_step` fails.
    """
    last_correction = np.inf
    for _ in range(most):
        try:
            step = newton_step(equations.at(here.weights, here.problem), normaliser)
        except np.linalg.LinAlgError:
            return here, False
        correction = float(np.linalg.norm(step) / np.linalg.norm(here.weights - step))
        if not np.isfinite(correction):
            return here, False
        if last_correction < SETTLED and correction > 0.5 * last_correction:
            return here, True
        if here.problem.share == 0.0:
            here = stabilizing_step(equations, here, step, 1.0)
        else:
            here = here._replace(weights=here.weights - step)
        last_correction = correction
        if not to_the_floor and correction <= TRACKING:
            return here, True
    return here, last_correction < SETTLED


def stabilizing_step(
    equations: StackEquations, here: Point, step: np.ndarray, fraction: float
) -> Point:
    """Return the point W - f N with the first tried f whose policy stabilizes the recorded plant.

    The tried values of f are `fraction`, fraction/2, fraction/4 and so on. For an LQ problem and a
    stabilizing policy of W, every f in (0, 1] gives a stabilizing policy, except for rounding and
    noise in the data.

    equations: Bellman residuals of the recorded samples
    here: the weights W, and the problem
    step: N, (M,)
    fraction: initial f

    Raises NoSolutionError if none of `MOST_HALVINGS` values of f gives a stabilizing policy.
    """
    for _ in range(MOST_HALVINGS):
        trial = here.weights - fraction * step
        if equations.margin(trial, here.problem) > 0.0:
            return here._replace(weights=trial)
        fraction *= 0.5
    raise NoSolutionError(
        "no step of the learning law keeps the recorded plant stable; record drifts F = A z of one"
        " linear plant, with little noise and without the reference forcing"
    )


def discount_at(progress: float, start: float) -> float:
    """Return the discount at a time of stage 2, β(p) = β₀ (1 - p) / (1 + 2 β₀ p), 1/s.

    The discount falls from β₀ at p = 0 to 0 at p = 1.

    progress: p in [0, 1]
    start: β₀, 1/s
    """
    return start * (1.0 - progress) / (1.0 + 2.0 * start * progress)


def lower_discount(
    equations: StackEquations, here: Point, target: float, normaliser: np.ndarray
) -> Point:
    """Return the solution of the LQ problem after the discount β is lowered to `target`, 1/s.

    Each step lowers β by at most half the stability margin. The policy therefore remains
    stabilizing.

    equations: Bellman residuals of the recorded samples
    here: solution at the present discount
    normaliser: as for `newton_step`

    Raises NoSolutionError if a step of β becomes too small, or if the Newton iteration does not
    converge.
    """
    while here.problem.discount > target:
        discount = here.problem.discount
        lower = max(target, discount - 0.5 * equations.margin(here.weights, here.problem))
        if lower > target and discount - lower <= SMALLEST_STEP * min(discount, 1.0):
            raise _unstable_mode_error(discount)
        there = here._replace(problem=here.problem._replace(discount=lower))
        here, converged = iterate(equations, there, normaliser, to_the_floor=False)
        if not converged:
            raise _unstable_mode_error(lower)
    return here


def _unstable_mode_error(discount: float) -> NoSolutionError:
    return NoSolutionError(
        f"the discount cannot be lowered below {discount:.6g} 1/s, where the learned policies"
        " leave a mode unstable; check that (A, B) is stabilizable and that Q weights the mode"
    )


def raise_disturbance(
    equations: StackEquations, here: Point, target: float, normaliser: np.ndarray, delta: float
) -> Point:
    """Return the solution of the game after the share s of 1/δ² is raised to `target`.

    For δ above its minimum the solution exists for every share s in [0, 1] and grows with s
    (monotonicity of the H-infinity Riccati equation in δ; Basar and Bernhard 1995). A step of s is
    accepted if the iteration converges to a P >= 0 for which A - S_s P is Hurwitz. Such a P is
    unique. A rejected step is halved. Without a disturbance the solution does not depend on s.

    equations: Bellman residuals of the recorded samples
    here: solution at the present share
    normaliser: as for `newton_step`
    delta: δ of the game

    Raises NoSolutionError, with the δ at which the solution ceases to exist, if a step becomes too
    small.
    """
    if not equations.disturbance.any():
        return here._replace(problem=here.problem._replace(share=target))
    step = target - here.problem.share
    while here.problem.share < target:
        share = min(target, here.problem.share + step)
        trial = here._replace(problem=here.problem._replace(share=share))
        end_point, converged = iterate(equations, trial, normaliser, to_the_floor=False, most=8)
        if converged and equations.margin(end_point.weights, end_point.problem) > 0.0:
            eigenvalues = np.linalg.eigvalsh(equations.basis.matrix(end_point.weights))
            if eigenvalues[0] > -1e-12 * eigenvalues[-1]:  # up to rounding
                here = end_point
                step = 2.0 * step
                continue
        step *= 0.5
        if step < max(SMALLEST_STEP * here.problem.share, NO_STEP):
            end = delta / np.sqrt(here.problem.share) if here.problem.share > 0.0 else np.inf
            raise NoSolutionError(
                f"the law finds no solution for delta = {delta:g}, because the solution ceases "
                f"to exist at delta = {end:.6g}; choose a larger delta (`hfa solve` reports the "
                "smallest)"
            )
    return here


#: Current point, normalization n_j of the stage (N_h,), and initial discount, 1/s.
Memory = tuple[Point, np.ndarray, float]
#: Initial weights count as stabilizing if their margin is at least this fraction of the fastest
#: closed-loop rate. With a smaller margin, the regressors are singular within rounding and the
#: first Newton direction is noise.
RELATIVE_MARGIN = 1e-8
#: Stability margin with the initial discount, 1/s, in addition to 1e-6 of the fastest closed-loop
#: rate.
DISCOUNT_MARGIN = 0.5
#: Largest number of sub-steps in one tick, and the fraction to which a sub-step must reduce |ē| for
#: another one.
MOST_SUBSTEPS = 50
STALLED = 0.999
#: A relative residual below this is rounding: the stage has converged.
AT_REST = 1e-13


#: Larger weights overflow when they are squared twice.
LARGEST_WEIGHT = 1e60
#: More recorded samples would fill the memory without benefit.
MOST_SAMPLES = 100_000


def enough_for(weights: int, least: int) -> int:
    """Return the default number of samples, at least `least` and at least 1.5 per weight."""
    return max(least, weights + (weights + 1) // 2)


def initial_weights(value: Any, basis: Basis) -> np.ndarray:
    """Return the initial weights W(0), (M,), in the model's units.

    value: one number for all weights, or M numbers
    basis: basis with M weights

    Raises BadInputError for a wrong number of weights, and for a weight that is not finite or is
    too large.
    """
    all_of_them = np.full(basis.size, value) if np.isscalar(value) else value
    weights = checked_matrix("initial_weights", all_of_them, LARGEST_WEIGHT, ndim=1)
    if weights.size != basis.size:
        raise BadInputError(
            f"initial_weights has {weights.size} elements; give {basis.size} for basis "
            f"'{basis.name}'"
        )
    return weights


@dataclass(frozen=True)
class CertifiedSettings:
    """Settings of the certified law.

    predefined_time: T_w, s
    tick: step of the recorded history, s
    eta: η in (0, 1), exponent of the scalar law
    theta: θ in (0, 1), the fraction of a stage's duration within which the stage converges
    basis: name of the basis
    samples: N_h >= M, number of samples chosen from the pool; None means 50, or more for a basis of
        more than 33 weights (`enough_for`)
    pool_samples: number of random states in the pool; None means the larger of 500 and 5 N_h
    initial_weights: W(0) in the model's units, one number for all or (M,)
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
        """Raise BadInputError, with the name of the setting, for a value outside its range."""
        for name in ("predefined_time", "tick", "eta", "theta"):
            refuse_unless_positive(name, getattr(self, name))
        for name in ("eta", "theta"):
            if getattr(self, name) >= 1.0:
                raise BadInputError(
                    f"{name} is {getattr(self, name)}; give a number between 0 and 1"
                )
        if self.tick > self.predefined_time:
            raise BadInputError(
                f"tick is {self.tick} s; give at most the predefined_time, {self.predefined_time} s"
            )
        for name, value in {"samples": self.samples, "pool_samples": self.pool_samples}.items():
            whole = isinstance(value, (int, np.integer)) and value is not True
            if value is not None and not (whole and 1 <= value <= MOST_SAMPLES):
                raise BadInputError(
                    f"{name} is {value}; give a whole number from 1 to {MOST_SAMPLES}"
                )


@dataclass(frozen=True, eq=False)
class CertifiedLaw:
    """Certified law in two stages of T = T_w/2 each, on recorded samples (z_j, F_j).

    The law uses only B, E, Q, R, N and δ of the game.

    Stage 1 solves the LQ problem (1/δ² = 0) by
        W' = -pinv(σ̄) k (|ē|^(1-η) + |ē|^(1+η)) ē/|ē|,  k = π/(2 η θ T),
    with the normalization n_j = sqrt(1 + σ_j'σ_j) at the start of the stage. σ̄W' is parallel to ē.
    |ē| therefore satisfies the scalar law y' = -k (y^(1-η) + y^(1+η)) and is 0 from θT on. In each
    tick, Newton sub-steps W <- W - f N use the f with which |ē| attains the exact scalar value.
    While no f attains this value, f minimizes |ē|. For f in (0, 1] such a step preserves stability.
    With the full step P₁ = P - N and A_f = A - S(P - fN),
        A_f'P₁ + P₁A_f = -Q - (1-f) PSP - f P₁SP₁ - f (P-P₁)S(P-P₁).
    If the initial policy is not stabilizing, the plant gets a discount β. The drift is then F - βz.

    Stage 2 lowers β to 0 and then raises 1/δ² to its final value. Stage 2 ends at T + θT.

    game: the game
    stack: chosen samples (z_j, F_j)
    drift_misfit: relative misfit of the linear fit of the drifts (`Stack.linear`)
    basis: basis of the value
    settings: settings of the law
    seed: seed of the samples
    """

    game: Game
    stack: Stack
    drift_misfit: float
    basis: Basis
    settings: CertifiedSettings
    seed: int

    @cached_property
    def equations(self) -> StackEquations:
        """Bellman residuals of the recorded samples."""
        return StackEquations.build(self.game, self.basis, self.stack, self.stack.channel_scales())

    @property
    def stage_time(self) -> float:
        """Duration T = T_w/2 of a stage, s."""
        return 0.5 * self.settings.predefined_time

    @property
    def ticks(self) -> int:
        """Number of ticks, T_w divided by the tick and rounded up. The last tick ends at T_w."""
        return int(np.ceil(self.settings.predefined_time / self.settings.tick - 1e-9))

    def time(self, tick: int) -> float:
        """Return the time at the end of tick number `tick` (1, 2, ...), s.

        The result is 0 for `tick` = 0, and at most the predefined time.
        """
        return min(tick * self.settings.tick, self.settings.predefined_time)

    def start(self) -> Memory:
        """Return the initial memory of the law: a point, a normalization and a discount.

        The point contains W(0). The normalization has shape (N_h,). The discount, 1/s, is 0 if W(0)
        stabilizes the plant with a decay rate of at least `RELATIVE_MARGIN` times the largest
        eigenvalue magnitude. Otherwise the discount is large enough for W(0) to stabilize the
        discounted plant.

        Raises BadInputError as `initial_weights` does.
        """
        weights = self.equations.scaled(initial_weights(self.settings.initial_weights, self.basis))
        eigenvalues = self.equations.closed_loop_eigenvalues(weights, LQ)
        abscissa = float(eigenvalues.real.max())
        fastest = float(np.abs(eigenvalues).max())
        stabilizing = abscissa < 0.0 and -abscissa >= RELATIVE_MARGIN * fastest
        discount = 0.0 if stabilizing else max(0.0, abscissa) + DISCOUNT_MARGIN + 1e-6 * fastest
        here = Point(weights, PartialGame(discount, 0.0))
        return here, self._normaliser(here), discount

    def _normaliser(self, here: Point) -> np.ndarray:
        """Return the normalization n_j = sqrt(1 + σ_j'σ_j) of each sample, (N_h,).

        here: weights and problem that determine the regressors σ_j
        """
        regressors = self.equations.at(here.weights, here.problem).regressors
        return np.sqrt(1.0 + np.sum(regressors**2, axis=1))

    def advance(self, tick: int, memory: Memory) -> Memory:
        """Return the memory at the end of a tick.

        Stage 1 acts in each tick that begins before θT. Stage 2 acts in each tick that ends after
        T, until the problem is the game itself.

        tick: number of the tick, 0 for the first
        memory: memory at the beginning of the tick
        """
        begin = self.time(tick)
        end = self.time(tick + 1)
        T = self.stage_time
        here, normaliser, first_discount = memory
        if begin < self.settings.theta * T:
            here = self._stage_one(here, normaliser, begin, end)
            if end >= self.settings.theta * T:
                normaliser = self._normaliser(here)
        if end > T and here.problem != GAME:
            here = self._stage_two(
                here, normaliser, first_discount, (end - T) / (self.settings.theta * T)
            )
        return here, normaliser, first_discount

    def _stage_one(self, here: Point, normaliser: np.ndarray, begin: float, end: float) -> Point:
        s = self.settings
        residual = self._law_residual(here, normaliser)
        rate = decay_rate(self.stage_time, s.eta, s.theta)
        target = (
            after(residual, rate, s.eta, end - begin) if end < s.theta * self.stage_time else 0.0
        )
        if target > 0.0:
            return self._descend(here, normaliser, target)
        if self.equations.at(here.weights, here.problem).relative <= AT_REST:
            return here
        return iterate(self.equations, here, normaliser, to_the_floor=True)[0]

    def _law_residual(self, here: Point, normaliser: np.ndarray) -> float:
        """Return |ē|, the norm of the normalized Bellman residuals, which the law reduces.

        here: weights and problem
        normaliser: (N_h,), normalization of the residuals
        """
        return float(
            np.linalg.norm(self.equations.at(here.weights, here.problem).residuals / normaliser)
        )

    def _descend(self, here: Point, normaliser: np.ndarray, target: float) -> Point:
        """Return the point after Newton steps that reduce the residual norm |ē| to `target`.

        The steps also end when |ē| no longer decreases, or after `MOST_SUBSTEPS` steps.

        here: initial weights, and the problem
        normaliser: (N_h,), normalization of the residuals
        target: norm |ē| to reach, positive

        Raises NoSolutionError if `stabilizing_step` fails, and numpy.linalg.LinAlgError as
        `newton_step` does.
        """
        last = np.inf
        for _ in range(MOST_SUBSTEPS):
            bellman = self.equations.at(here.weights, here.problem)
            residuals = bellman.residuals / normaliser
            size = float(np.linalg.norm(residuals))
            if size <= target * (1.0 + 1e-9) or size > STALLED * last:
                break
            last = size
            step = newton_step(bellman, normaliser)
            linear, quadratic = self.equations.along_step(here.weights, step, bellman, here.problem)
            fraction = fraction_to_reach(
                residuals, linear / normaliser, quadratic / normaliser, target
            )
            here = stabilizing_step(self.equations, here, step, fraction)
        return here

    def _stage_two(
        self, here: Point, normaliser: np.ndarray, first_discount: float, clock: float
    ) -> Point:
        """Return the weights and problem that stage 2 reaches at a time of the stage.

        If the initial discount is positive, the first half of the stage lowers β and the second
        half raises 1/δ². Otherwise the full stage raises 1/δ². At the end of the stage, Newton
        steps continue to rounding, and `Riccati.refined` corrects P.

        here: weights and problem at the present time
        normaliser: (N_h,), normalization of the residuals
        first_discount: initial discount, 1/s
        clock: time since the beginning of the stage, as a fraction of θT, at which the stage ends

        Raises NoSolutionError as `lower_discount` and `raise_disturbance` do.
        """
        clock = 1.0 if clock >= 1.0 - 1e-12 else clock
        split = 0.5 if first_discount > 0.0 else 0.0
        if here.problem.discount > 0.0:
            lower = discount_at(min(1.0, clock / split), first_discount)
            here = lower_discount(self.equations, here, lower, normaliser)
        if clock > split:
            share = (clock - split) / (1.0 - split)
            here = raise_disturbance(self.equations, here, share, normaliser, self.game.delta)
        if clock == 1.0:
            here = iterate(self.equations, here, normaliser, to_the_floor=True)[0]
            # If P is large in one direction, the other directions are small differences in a
            # sample. In the Riccati equation of the drifts' linear fit they are separate entries,
            # which determine their last digits.
            e = self.equations
            riccati = Riccati(e.drift_matrix, e.control, e.disturbance, e.Q)
            P = riccati.refined(self.basis.matrix(here.weights))
            quadratic = self.basis.quadratic_size
            weights = np.concatenate([self.basis.weights(P)[:quadratic], here.weights[quadratic:]])
            here = here._replace(weights=weights)
        return here

    def observe(self, tick: int, memory: Memory) -> Mapping[str, Any]:
        """Return the time, the weights in the model's units and the residual norms after `tick`
        ticks.

        The result is one row of the history (`ticks.run`).
        """
        here, _, _ = memory
        return {
            "time": self.time(tick),
            "weights": self.equations.unscaled(here.weights),
            **self.equations.reported_residuals(here.weights),
        }

    def conclude(self, finished: Run) -> TrainingRun:
        """Return the training run of the law.

        finished: last memory and history of all ticks
        """
        _, _, first_discount = finished.memory
        return training_run(
            "certified",
            self.game,
            self.equations,
            finished.history,
            self.equations.excitation,
            seed=self.seed,
            diagnostics={
                "discount_at_start": first_discount,
                "drift_misfit": self.drift_misfit,
            },
        )


def certified_law(
    game: Game, chosen: CertifiedSettings, seed: int, pool: Stack | None = None
) -> CertifiedLaw:
    """Return the certified law for a game, with its recorded samples.

    The drifts are replaced by their linear fit over all samples. The fit reduces the effect of
    noise. The law then uses the samples that differ most (`choose`).

    game: the game
    chosen: settings of the law
    seed: seed of random samples
    pool: recorded samples, or None for random ones (`random_pool`)

    Raises BadInputError if the name of the basis is unknown, if the number or the rank of the
    chosen samples is below the number of basis functions, or if the pool is smaller than the number
    of samples.
    """
    functions = basis(chosen.basis, game.A.shape[0])
    samples = enough_for(functions.size, 50) if chosen.samples is None else chosen.samples
    pool_samples = max(500, 5 * samples) if chosen.pool_samples is None else chosen.pool_samples
    recorded = random_pool(game, pool_samples, seed) if pool is None else pool
    fitted, misfit = recorded.linear()
    chosen = replace(chosen, samples=samples, pool_samples=pool_samples)
    return CertifiedLaw(game, choose(fitted, functions, samples), misfit, functions, chosen, seed)
