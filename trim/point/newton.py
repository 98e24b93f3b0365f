"""Newton's method for r(z, c) = 0, at N points at once or at one."""

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
    """Return the unknowns (N, k) after Newton's method, and the mask (N,) of the settled points.

    A step J d = -r is halved until the norm of r falls, or that of J⁻¹ r, which does not depend on
    the scales of the equations. A step from a residual of `NEARLY` or less is the last of its
    point, which is then settled. Where J is singular or not square, d is the least-norm solution. A
    point that does not settle keeps the best unknowns found.

    system: the equations r(z, c)
    z: (N, k), initial unknowns
    c: (N, ..), constants that differ between the points
    moving: indices of the unknowns that may move; by default all
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
