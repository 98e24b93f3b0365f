"""Newton (policy-iteration) steps on the recorded stack, guarded where theory says that they keep stability."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from controller.samples.stack_equations import PartialGame, StackEquations, newton_step
from hfa_model.support.errors import NoSolutionError

#: A Newton correction below this fraction of |W| ends the iteration on the way (the next one is its square).
TRACKING = 1e-5
#: Below this fraction of |W| a correction that no longer halves is rounding, or noise in the data.
SETTLED = 1e-6
#: How often a step that loses stability is halved.
MOST_HALVINGS = 30


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
