"""Newton's method for r(z, c) = 0 at one or many points."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from trim.point.system import TrimSystem


def newton(
    system: TrimSystem,
    z: np.ndarray,
    c: np.ndarray,
    moving: np.ndarray | None = None,
    bounded: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
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
    """
    if moving is not None or bounded or not system.is_quick:
        from trim.point.halving import halving

        return halving(system, z, c, moving, bounded)
    best, settled, unsolved = system.quick_steps(z, c)
    if unsolved.any():
        from trim.point.halving import halving

        best[unsolved], settled[unsolved] = halving(system, z[unsolved], c[unsolved])
    return best, settled
