"""Simulation of the aircraft over one sample with held inputs, X⁺ = F(X, U)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import rk4
from hfa_aircraft.layout import Layout
from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import in_gusts
from hfa_support.matrices import spectral_radius
from trim.linear.delays import step_count
from trim.point.operating_point import OperatingPoint

#: Longest integration step, in time constants of the fastest mode. The error is 1e-6 of a
#: deviation.
_LONGEST = 0.2
#: Longest integration step, s, so that extremes between steps are known.
_SECONDS = 0.02
_MOST_PARTS = 1000
#: Number of states drawn in each box of initial conditions.
_DRAWN = 16


def parts_of_a_sample(
    points: Sequence[OperatingPoint],
    dt: float,
    boxes: Sequence[np.ndarray] | None = None,
    longest: float = _LONGEST,
) -> int:
    """Return the number of integration steps in a sample, from 1 to `_MOST_PARTS`.

    The number follows from the fastest mode of the aircraft at the trims and in the boxes. A step
    is at most `_SECONDS`.

    dt: sample time, s
    boxes: half-widths (k,) of the initial conditions about each trim, or None
    longest: longest step, in time constants of the fastest mode
    """
    fastest = max(fastest_mode(point, np.zeros(len(point.model.linear))) for point in points)
    if boxes is not None:
        for point, half_widths in zip(points, boxes, strict=True):
            fastest = max(fastest, fastest_mode(point, half_widths))
    parts = max(step_count(dt * fastest, longest), step_count(dt, _SECONDS))
    return min(parts, _MOST_PARTS)


def fastest_mode(point: OperatingPoint, half_widths: np.ndarray) -> float:
    """Return the largest magnitude of a mode of the aircraft at states of a box about a trim, 1/s.

    The states are the centers of the faces, and `_DRAWN` drawn corners; of a box without width, the
    trim. A state at which the equations are not defined is left out.

    half_widths: (k,), of the linear states
    """
    model = point.model
    rows = model.state_places(model.linear)
    k = len(rows)
    shares = np.zeros((1, k))
    if half_widths.any():
        corners = np.random.default_rng(0).choice([-1.0, 1.0], (_DRAWN, k))
        shares = np.vstack([np.eye(k), -np.eye(k), corners])
    fastest = 0.0
    for share in shares:
        X = point.x  # a new array
        X[rows] += share * half_widths
        A = model.at(type(point.states)(*X.tolist()), point.inputs).A
        if np.isfinite(A).all():
            fastest = max(fastest, spectral_radius(A))
    return fastest


@lru_cache(maxsize=16)
def rate_in_push(layout: Layout, linear: tuple[str, ...], winds: tuple[str, ...]) -> ca.Function:
    """Return the function [X; U; push; p] -> X' = f(X, U, p, w) + d with (d, w) = push.

    linear: states to whose rates d is added
    winds: disturbances w
    """
    names = layout.names
    pushes = len(linear) + len(winds)
    sizes = (len(names.states), len(names.inputs), pushes, len(names.parameters))
    vectors = zip(("X", "U", "push", "p"), sizes, strict=True)
    X, U, push, p = (ca.SX.sym(name, size) for name, size in vectors)
    every_wind = None  # the equations in still air
    if winds:
        wind = dict(zip(winds, ca.vertsplit(push)[len(linear) :], strict=True))
        every_wind = [wind.get(name, 0.0) for name in names.disturbances]
    unpushed, _ = layout.expressions((X, U, p), (), every_wind)
    rates = [
        rate + (push[linear.index(name)] if name in linear else 0.0)
        for name, rate in zip(names.states, ca.vertsplit(unpushed), strict=True)
    ]
    column = ca.densify(ca.vertcat(*rates))
    return ca.Function("rate", [ca.vertcat(X, U, push, p)], [column], {"cse": True})


@lru_cache(maxsize=16)
def step_of_integration(
    layout: Layout, linear: tuple[str, ...], winds: tuple[str, ...]
) -> ca.Function:
    """Return the function [X; U; push; p; h] -> X after h seconds, one Runge-Kutta step of order 4.

    The rates are those of `rate_in_push`.
    """
    inlined = rate_in_push(layout, linear, winds)
    n, arguments = len(layout.names.states), inlined.sx_in()
    # The four calls of a step share the code of the rates.
    rate = ca.Function("rate", arguments, inlined.call(arguments), {"never_inline": True})
    x, others, h = (ca.SX.sym("x", size) for size in (n, rate.numel_in() - n, 1))
    after = rk4(lambda x, _: rate(ca.vertcat(x, others)), x, h)
    return ca.Function("step", [ca.vertcat(x, others, h)], [after], {"never_inline": True})


def held_step(model: Model, dt: float, parts: int, winds: tuple[str, ...]) -> ca.Function:
    """Return the function (X, U, push, p) -> (X after dt seconds, extremes on the way).

    The extremes are the lowest and the highest X after each of `parts` integration steps, (2 n,).

    X: (n,), absolute values
    U: (m,), absolute values, held
    push: (k + w,), rates added to those of the linear states, then the disturbances `winds`
    p: parameters of the model
    """
    layout = in_gusts(model).layout if winds else model.layout
    step = step_of_integration(layout, model.linear, winds)
    pushes = len(model.linear) + len(winds)
    sizes = (len(model.states), len(model.inputs), pushes, len(model.parameters))
    X, U, push, p = (ca.MX.sym("x", size) for size in sizes)
    after = step(ca.vertcat(X, U, push, p, dt / parts))
    lowest = highest = after
    for _ in range(parts - 1):
        after = step(ca.vertcat(after, U, push, p, dt / parts))
        lowest, highest = ca.fmin(lowest, after), ca.fmax(highest, after)
    extremes = ca.vertcat(lowest, highest)
    return ca.Function("held_step", [X, U, push, p], [after, extremes])


def slices_of(sizes: Sequence[int]) -> list[slice]:
    """Return the slices of successive parts of a vector."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(*pair) for pair in pairwise(ends)]
