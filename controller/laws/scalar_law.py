"""The predefined-time law of one number, and the step that makes a residual obey it exactly."""

from __future__ import annotations

import math

import numpy as np


def decay_rate(time: float, eta: float, theta: float) -> float:
    """k = π / (2 η θ T): with it y' = -k (y^(1-η) + y^(1+η)) is 0 from θT on, whatever y(0)."""
    return math.pi / (2.0 * eta * theta * time)


def after(y: float, rate: float, eta: float, step: float) -> float:
    """Exact value of y' = -rate (y^(1-η) + y^(1+η)) after `step` seconds from y >= 0.

    x = y^η obeys x' = -η rate (1 + x²), so that y₊ = tan(max(0, atan(y^η) - η rate step))^(1/η).
    """
    return math.tan(max(0.0, math.atan(y**eta) - eta * rate * step)) ** (1.0 / eta)


def fraction_to_reach(constant: np.ndarray, linear: np.ndarray, quadratic: np.ndarray, target: float) -> float:
    """The smallest f in (0, 1] with |constant + f linear + f² quadratic| = target, else the best f in (0, 1].

    The vectors are residuals along a Newton direction, (N_h,). When no f reaches the target, the f with the
    smallest norm is returned (exact line search; Benner & Byers 1998), or 1 when no step lowers it.
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
    reached = _roots_in_unit_interval(square - np.array([0.0, 0.0, 0.0, 0.0, target**2])) if target > 0.0 else []
    if reached:
        return reached[0]
    lowest = min([1.0, *_roots_in_unit_interval(np.polyder(square))], key=lambda f: float(np.polyval(square, f)))
    return lowest


def _roots_in_unit_interval(polynomial: np.ndarray) -> list[float]:
    """Roots f in (0, 1] of a polynomial, ascending; found as 1/f, whose leading coefficient is never the small one."""
    reversed_ = polynomial[::-1] / np.abs(polynomial).max()
    if not np.all(np.isfinite(reversed_)):
        return []
    inverse = np.roots(reversed_)
    real = inverse.real[np.abs(inverse.imag) <= 1e-9 * np.abs(inverse)]
    return sorted(1.0 / float(root) for root in real if root >= 1.0)
