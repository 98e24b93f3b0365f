"""Newton (policy-iteration) steps on the recorded stack, guarded where theory says that they keep stability.

From the discounted LQ problem to the game: the discount is removed first, then 1/δ² is raised.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.training_data.stack_equations import PartialGame, StackEquations, newton_step
from hfa_support.errors import NoSolutionError

#: A Newton correction below this fraction of |W| ends the iteration on the way (the next one is its square).
TRACKING = 1e-5
#: Below this fraction of |W| a correction that no longer halves is rounding, or noise in the data.
SETTLED = 1e-6
#: How often a step that loses stability is halved.
MOST_HALVINGS = 30
#: The smallest relative step of β and of the share of 1/δ²: below it the ramp has reached the end of its road.
SMALLEST_STEP = 1e-9
#: A first step of the share that is too large even here belongs to no plant.
NO_STEP = 1e-30


class Point(NamedTuple):
    """Where the learning stands. weights: (M,), scaled coordinates. solves: linear solves spent so far."""

    weights: np.ndarray
    problem: PartialGame
    solves: int


def iterate(
    equations: StackEquations, here: Point, normaliser: np.ndarray, *, to_the_floor: bool, most: int = 100
) -> tuple[Point, bool]:
    """Full Newton steps W <- W - N at a fixed problem; the last point and whether it converged.

    to_the_floor: go on until the correction no longer halves, otherwise stop at TRACKING. On an LQ problem
    (share 0) the steps are those of Kleinman (1968), which converge from every stabilizing policy, and each is
    guarded by `stabilizing_step`.
    """
    last = np.inf
    for _ in range(most):
        try:
            step = newton_step(equations.at(here.weights, here.problem), normaliser)
        except np.linalg.LinAlgError:
            return here, False
        correction = float(np.linalg.norm(step) / np.linalg.norm(here.weights - step))
        if not np.isfinite(correction):
            return here, False
        if last < SETTLED and correction > 0.5 * last:
            return here, True
        if here.problem.share == 0.0:
            here = stabilizing_step(equations, here, step, 1.0)
        else:
            here = Point(here.weights - step, here.problem, here.solves + 1)
        last = correction
        if not to_the_floor and correction <= TRACKING:
            return here, True
    return here, last < SETTLED


def stabilizing_step(equations: StackEquations, here: Point, step: np.ndarray, fraction: float) -> Point:
    """W - f N, with f halved until the policy stabilizes the recorded plant.

    On the LQ problem every f in (0, 1] does so in exact arithmetic with exact data; rounding and noise can
    break it. Raises NoSolutionError when no step does.
    """
    for _ in range(MOST_HALVINGS):
        trial = here.weights - fraction * step
        if equations.margin(trial, here.problem) > 0.0:
            return Point(trial, here.problem, here.solves + 1)
        fraction *= 0.5
    raise NoSolutionError(
        "no step of the learning law keeps the recorded plant stable; check that the recorded drifts are F = A z"
        " of one linear plant, without the reference forcing and with little noise"
    )


def discount_at(progress: float, start: float) -> float:
    """β(p) = β₀ (1 - p) / (1 + 2 β₀ p), 1/s: β₀ at p = 0, 0 at p = 1, and slow where P changes (β below 1)."""
    return start * (1.0 - progress) / (1.0 + 2.0 * start * progress)


def lower_discount(equations: StackEquations, here: Point, target: float, normaliser: np.ndarray) -> Point:
    """Follow the LQ solution to a smaller discount β.

    A step of at most half the stability margin keeps the policy stabilizing, and from a stabilizing policy the
    full Newton iteration of an LQ problem converges, so only a plant that no input can stabilize stops this:
    NoSolutionError.
    """
    while here.problem.discount > target:
        discount = here.problem.discount
        lower = max(target, discount - 0.5 * equations.margin(here.weights, here.problem))
        if lower > target and discount - lower <= SMALLEST_STEP * min(discount, 1.0):
            raise _not_brought_to_rest(discount)
        there = here._replace(problem=here.problem._replace(discount=lower))
        here, converged = iterate(equations, there, normaliser, to_the_floor=False)
        if not converged:
            raise _not_brought_to_rest(lower)
    return here


def _not_brought_to_rest(discount: float) -> NoSolutionError:
    return NoSolutionError(
        f"the discount cannot be lowered below {discount:.6g} 1/s: the policies learned there do not bring a mode to"
        " rest; check that (A, B) is stabilizable and that Q sees the mode"
    )


def raise_disturbance(
    equations: StackEquations, here: Point, target: float, normaliser: np.ndarray, delta: float
) -> Point:
    """Follow the game solution to a larger share s of 1/δ².

    For δ above its minimum the solution exists for every s in [0, 1] and grows with s (monotonicity of the
    H-infinity Riccati equation in δ; Basar & Bernhard 1995). A step is taken only when the iteration converged
    to P >= 0 with A - S_s P Hurwitz, of which there is one, and is halved otherwise.

    Raises NoSolutionError with the δ at which the solution is lost.
    """
    step = target - here.problem.share
    while here.problem.share < target:
        share = min(target, here.problem.share + step)
        trial = here._replace(problem=here.problem._replace(share=share))
        found, converged = iterate(equations, trial, normaliser, to_the_floor=False, most=8)
        if converged and _is_stabilizing_solution(equations, found):
            here, step = found, 2.0 * step
            continue
        here, step = here._replace(solves=found.solves), 0.5 * step
        if step < max(SMALLEST_STEP * here.problem.share, NO_STEP):
            end = delta / np.sqrt(here.problem.share) if here.problem.share > 0.0 else np.inf
            raise NoSolutionError(
                f"delta = {delta:g} is out of reach: followed down from infinity, the game solution is lost at"
                f" delta = {end:.6g}; raise delta above that, unless the smallest possible one (hfa solve) lies below"
            )
    return here


def _is_stabilizing_solution(equations: StackEquations, point: Point) -> bool:
    """Whether A - S_s P is Hurwitz and P >= 0 up to rounding."""
    eigenvalues = np.linalg.eigvalsh(equations.basis.matrix(point.weights))
    positive = eigenvalues[0] > -1e-12 * eigenvalues[-1]
    return bool(positive and equations.margin(point.weights, point.problem) > 0.0)
