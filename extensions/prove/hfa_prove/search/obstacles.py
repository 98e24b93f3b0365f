"""Lowest level of a function V at which samples find an obstacle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Function of state deviations (N, n), with values (N,).
ValueOf = Callable[[np.ndarray], np.ndarray]
#: Bisections between the last sample without an obstacle and the first with one.
_HALVINGS = 12
#: Number of rays around which the next rays are drawn, and number of rays around each.
_NEAREST = 12
_AROUND = 30


def first_obstacle(
    is_obstacle: ValueOf, V: ValueOf, T: np.ndarray, *, quick: bool = False
) -> tuple[float, np.ndarray | None]:
    """Return the lowest V found at an obstacle and the state deviation z (n,), or (inf, None).

    is_obstacle: state deviations (N, n) -> mask (N,) of the obstacles
    V: function of state deviations (N, n)
    T: matrix of the coordinates z = T y, (n, n), with samples in the unit ball of y
    quick: whether to use fewer samples
    """
    n = len(T)
    samples = 300 if quick else 2000
    turns = 6 if quick else 14
    radii = np.linspace(0.05, 1.0, 20 if quick else 40)
    generator = np.random.default_rng(0)
    directions = _unit(generator.normal(size=(samples, n)))
    best = np.inf
    place = None
    spread = 0.5
    for _ in range(turns):
        found = _along(is_obstacle, directions @ T.T, radii)
        values = np.where(np.isfinite(found), found, 1.0)
        points = (directions * values[:, None]) @ T.T
        levels = np.where(np.isfinite(found), V(points), np.inf)
        order = np.argsort(levels)[:_NEAREST]
        if levels[order[0]] < best:
            best = float(levels[order[0]])
            place = points[order[0]]
        if not np.isfinite(best):
            directions = _unit(generator.normal(size=(samples, n)))
            continue
        near = directions[order[np.isfinite(levels[order])]]
        tried = np.repeat(near, _AROUND, axis=0)
        directions = _unit(tried + spread * generator.normal(size=tried.shape) / np.sqrt(n))
        directions = np.concatenate([near, directions])
        spread *= 0.7
    return best, place


def _along(is_obstacle: ValueOf, rays: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return for each ray z (N, n) the lowest factor at which an obstacle is found, or inf, (N,).

    radii: increasing factors that are tried before the bisection
    """
    count, n = rays.shape
    points = (radii[:, None, None] * rays).reshape(-1, n)
    found_at = is_obstacle(points).reshape(len(radii), count)
    first = np.where(found_at.any(axis=0), found_at.argmax(axis=0), -1)
    found = np.full(count, np.inf)
    hit = first >= 0
    if not hit.any():
        return found
    high = radii[first[hit]]
    low = np.where(first[hit] > 0, radii[first[hit] - 1], 0.0)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        there = is_obstacle(middle[:, None] * rays[hit])
        high = np.where(there, middle, high)
        low = np.where(there, low, middle)
    found[hit] = high
    return found


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / lengths)
