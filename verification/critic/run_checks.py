"""What only a run of a law can be asked: the richness of its data, the time it took, and where it began."""

from __future__ import annotations

import math

import numpy as np

from controller.game.basis import Basis
from controller.game.learning_result import LearningResult
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import relative_residual
from hfa_support.reporting.checks import Check, at_least, at_most

#: Relative Riccati residual, in balanced units, below which a run counts as settled.
SETTLED = 1e-9


def run_checks(game: Game, run: LearningResult, functions: Basis, predefined_time: float | None) -> tuple[Check, ...]:
    """The richness of the data, as the run says it; the settling time only of a law that promises one."""
    rank = run.excitation
    rich = at_least("data_rank", rank.rank, rank.size, f"the data have rank {rank.rank} of {rank.size}")
    if predefined_time is None:
        return (rich,)
    settled = settling_time(game, run, functions)
    late = f"the residual settles at {settled:.4g} s" if math.isfinite(settled) else "the residual does not settle"
    return (rich, at_most("settling_time", settled, predefined_time, f"{late}, not within T_w = {predefined_time:g} s"))


def settling_time(game: Game, run: LearningResult, functions: Basis) -> float:
    """First time from which the Riccati residual of the run's P(t) stays within `SETTLED`, s; inf when it does not.

    Computed from the recorded weights, with `certificate.relative_residual` in balanced units: whatever the law
    measures is not asked.
    """
    units = balanced_units(game)
    balanced, squared = in_units(game, units), np.outer(units, units)
    residuals = np.array([relative_residual(balanced, functions.matrix(weights) * squared) for weights in run.weights])
    return settled_at(run.times, residuals, SETTLED)


def settled_at(times: np.ndarray, sizes: np.ndarray, limit: float) -> float:
    """First time from which sizes (N,) stay within the limit to the end, s; inf when the last one does not."""
    above = np.flatnonzero(~(sizes <= limit))
    first = int(above[-1]) + 1 if len(above) else 0
    return float(times[first]) if first < len(times) else math.inf


def poor_data(run: LearningResult) -> str:
    """What a rank below the number of weights means, or ""."""
    if run.excitation.rank >= run.excitation.size:
        return ""
    return (
        f"the data have rank {run.excitation.rank} of {run.excitation.size}: whatever their residual, they do not "
        "determine the weights"
    )


def worthless_start(game: Game, run: LearningResult, functions: Basis) -> str:
    """What a start without a value means for every law but `certified`, which discounts it, or ""."""
    start = spectrum(game.A - game.B @ game.gain(functions.matrix(run.weights[0]))).abscissa
    if start < 0.0 or run.law == "certified":
        return ""
    return (
        f"the run starts from a policy that does not stabilize (abscissa of A - B K {start:+.3g} 1/s) and has "
        "no value to learn from; give initial_weights of a stabilizing one"
    )
