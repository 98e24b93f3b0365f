"""Newton's method for trims at many points, with halved steps."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from trim.point.system import FEW, NEARLY, NewtonEnds, TrimSystem, step_rows

#: Largest number of evaluations of a point.
MOST_TRIALS = 100
#: Smallest fraction of a step that is tried.
LEAST_SHARE = 2.0**-20
#: Singular values of a Jacobian below this fraction of the largest are 0 in a step of least norm,
#: whose end is judged by its residuals.
_SINGULAR = 1e-12
#: Largest entry of a step, in scaled units; a Jacobian with a longer step counts as singular.
LONGEST = 1e6


def newton(
    system: TrimSystem,
    z: np.ndarray,
    c: np.ndarray,
    moving: np.ndarray | None = None,
    bounded: bool = False,
    rows: list[int] | None = None,
) -> NewtonEnds:
    """Return the unknowns (N, k) after Newton's method, and the mask (N,) of converged points.

    A step J d = -r is halved until |r| or |J⁻¹ r| decreases. |J⁻¹ r| does not depend on the scales
    of the equations. A step from a residual of at most `NEARLY` is the last one, and the point has
    then converged. If J is singular or not square, d is the solution of least norm. A point that
    does not converge keeps the best unknowns found.

    system: the equations r(z, c)
    z: (N, k), initial unknowns
    c: (N, ..), constants that differ between the points
    moving: indices of the unknowns that may change; by default all
    bounded: whether every trial is moved to the nearest point within the limits; angles without
        limits are then limited to 90 deg
    rows: indices of the equations that are solved, with `moving`; by default all
    """
    chosen = slice(None) if rows is None else rows
    best = z.copy()
    converged = np.zeros(len(z), dtype=bool)
    if moving is None and not bounded and system.equations.square and z.shape[1] <= FEW:
        # The usual case: few unknowns, for which full steps converge.
        end, flags = step_rows(system.equations, system.steps)(z, c)
        converged = flags[:, 0] == 1.0
        best[converged] = end[converged]
    points = np.flatnonzero(~converged)
    if not points.size:
        return NewtonEnds(best, converged)
    # Of the points that have not converged, at their best unknowns:
    parts = system.residuals(best[points], c[points])
    residual, jacobian = (part[:, chosen] for part in parts)
    size = _norm(residual)
    step = newton_step(jacobian, residual, moving)
    share = np.ones(len(points))  # fraction of the step to be tried next
    for _ in range(MOST_TRIALS):
        # Points near a solution take their last step. Those with too short a step are given up.
        is_near = size <= NEARLY
        is_finished = is_near & np.isfinite(step).all(axis=1)
        best[points[is_finished]] += step[is_finished]
        converged[points[is_finished]] = True
        continues = ~is_near & (share >= LEAST_SHARE)
        points, size, jacobian = points[continues], size[continues], jacobian[continues]
        step, share = step[continues], share[continues]
        if not points.size:
            break

        trial = best[points] + share[:, None] * step
        if bounded:
            lowest = np.maximum(system.lowest, -system.quarter_turn)
            trial = np.clip(trial, lowest, np.minimum(system.highest, system.quarter_turn))
        parts = system.residuals(trial, c[points])
        residual, next_jacobian = (part[:, chosen] for part in parts)
        is_better = _norm(residual) < size
        if not is_better.all():
            # The natural monotonicity test (Deuflhard, Newton Methods for Nonlinear Problems,
            # Section 3.3): |J⁻¹ r| decreases with the last J.
            shortened = _norm(newton_step(jacobian, residual, moving))
            is_better |= shortened < (1.0 - share / 4.0) * _norm(step)
        is_better &= np.isfinite(next_jacobian).all(axis=(1, 2))

        best[points[is_better]] = trial[is_better]
        size[is_better] = _norm(residual[is_better])
        jacobian[is_better] = next_jacobian[is_better]
        step[is_better] = newton_step(next_jacobian[is_better], residual[is_better], moving)
        share = np.where(is_better, 1.0, share / 2.0)
    return NewtonEnds(best, converged)


def newton_step(
    jacobian: np.ndarray, residual: np.ndarray, moving: np.ndarray | None = None
) -> np.ndarray:
    """Return the Newton steps d (N, k) with J d = -r.

    If J is singular or not square, or d has an entry above `LONGEST`, the step of least norm is
    returned. If J or r is not finite, the step is nan.

    jacobian: J, (N, m, k)
    residual: r, (N, m)
    moving: indices of the unknowns that may change; by default all
    """
    count, rows, unknowns = jacobian.shape
    if moving is not None:
        step = np.zeros((count, unknowns))
        step[:, moving] = newton_step(jacobian[:, :, moving], residual)
        return step
    step = np.full((count, unknowns), np.nan)
    if rows == unknowns:
        with suppress(np.linalg.LinAlgError):  # if a Jacobian is singular
            step = np.linalg.solve(jacobian, -residual[:, :, None])[:, :, 0]
        if np.abs(step).max(initial=0.0) < LONGEST:
            return step
    doubtful = ~(np.abs(step).max(axis=1, initial=0.0) < LONGEST)
    doubtful &= np.isfinite(jacobian).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1)
    inverse = np.linalg.pinv(jacobian[doubtful], rcond=_SINGULAR)
    step[doubtful] = -(inverse @ residual[doubtful][:, :, None])[:, :, 0]
    return step


def _norm(rows: np.ndarray) -> np.ndarray:
    """Return the Euclidean norm of each row, (N,), without the overflow warnings of np.linalg."""
    return np.sqrt(np.einsum("ij,ij->i", rows, rows))
