"""The unsteady dynamics compared with `newton` (all effects at 0), with a derivation from energies,
with the functions of Theodorsen, Wagner and Küssner, and with the steady limit.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import pytest
from lagrangian import STILL, winds_of
from numpy.testing import assert_allclose
from random_points import WINDS, random_points, rates, wind_of
from scipy import special
from standard_air import density
from unsteady_energy import GUST, MOTION, derived_unsteady

from hfa import linearize, trim
from hfa_model import STATES, UNSTEADY, Input, Parameters, State
from trim import usual_condition

DEGREES = np.pi / 180
LAG_STATES = tuple(UNSTEADY.states)[len(STATES) :]
EFFECTS = tuple(UNSTEADY.parameters)[len(Parameters._fields) :][:6]
Lag = tuple[tuple[float, float], tuple[float, float]]


def points(count: int, seed: int) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return random states (with lag states), inputs and winds for `count` points.

    The ranges are wider than those of any trim.
    """
    rng, (states, inputs) = np.random.default_rng(seed), random_points(count, seed)
    lags = rng.uniform(-0.3, 0.3, (count, len(LAG_STATES)))
    winds = rng.uniform(-6, 6, (count, len(WINDS)))
    return list(zip(np.hstack([states, lags]), inputs, winds, strict=True))


def test_without_effects_rates_equal_newton(parameters: Parameters) -> None:
    """With all effects at 0, the rates equal those of `newton`."""
    plain = UNSTEADY.with_parameters(**parameters._asdict(), **dict.fromkeys(EFFECTS, 0.0))
    as_record = plain.layout.record
    for x, u, w in points(10, 3):
        vectors = [
            as_record(*vector)
            for vector in zip(
                "xupw", (values.tolist() for values in (x, u, plain.p, w)), strict=True
            )
        ]
        computed = plain.equations(*vectors)[0]
        winds = wind_of(w.tolist())
        expected = rates(State(*x[:7].tolist()), Input(*u.tolist()), parameters, "newton", winds)
        assert_allclose(
            [float(computed[name]) for name in STATES], expected, rtol=1e-12, atol=1e-11
        )


def by_name(*vectors: Any) -> tuple[Any, ...]:
    return tuple(
        UNSTEADY.layout.record(*vector)
        for vector in zip("xupw", map(ca.vertsplit, vectors), strict=True)
    )


@cache
def by_energies() -> ca.Function:
    """Return the function (x, u, p, w, x₀') -> (x', [dE/dt, power]) from the second derivation.

    x' are the rates with the wind w. dE/dt and the power of the loads are those without wind for
    the given rates x₀'.
    """
    vectors = [*UNSTEADY.layout.symbols("x", "u", "p"), ca.SX.sym("w", len(WINDS))]
    x, u, p, w = by_name(*vectors)
    derived = derived_unsteady(x, u, density(x.altitude), p, winds_of(w))
    derived_rates = ca.vertcat(*derived.rates, *(derived.lag_rates[name] for name in LAG_STATES))
    thin = ca.SX.sym("density")
    energetic = derived_unsteady(x, u, thin, p, STILL)  # the density is constant along the path
    moving = ca.SX.sym("moving", vectors[0].numel())
    balance = ca.vertcat(ca.jtimes(energetic.energy, vectors[0], moving), energetic.power)
    return ca.Function(
        "other",
        [*vectors, moving],
        [derived_rates, ca.substitute(balance, thin, density(x.altitude))],
    )


def worst(effects: np.ndarray | None = None) -> tuple[float, float]:
    """Return the largest relative error of a rate, and of the power, in the product's equations.

    The reference is `by_energies` at random points.

    effects: (N, 6), values of the effects, used in turn; by default all 1
    """
    vectors = [*UNSTEADY.layout.symbols("x", "u", "p"), ca.SX.sym("w", len(WINDS))]
    rates_by_name = UNSTEADY.equations(*by_name(*vectors))[0]
    mine = ca.Function(
        "mine", vectors, [ca.vertcat(*(rates_by_name[name] for name in UNSTEADY.states))]
    )
    computed = []
    for number, (x, u, w) in enumerate(points(12, 5)):
        p = UNSTEADY.p.copy()
        if effects is not None:
            p[18:24] = effects[number % len(effects)]
        derived_rates, balance = by_energies()(x, u, p, w, mine(x, u, p, 0 * w))
        (rates, others), (growth, power) = (
            (np.array(mine(x, u, p, w)), np.array(derived_rates)),
            np.array(balance).ravel(),
        )
        computed.append(
            (
                np.abs((rates - others) / (1 + np.abs(others))).max(),
                abs(growth - power) / (1e3 + abs(power)),
            )
        )
    most = np.max(computed, axis=0)
    return float(most[0]), float(most[1])


def test_rates_and_power_equal_those_from_energies() -> None:
    """The rates equal those of the Euler-Lagrange equations, and dE/dt equals the power of the
    loads.

    The equations include the carried air. The test uses all effects, each effect alone, and random
    fractions of all effects.
    """
    assert max(worst()) < 1e-11
    some = np.vstack([np.eye(6), np.random.default_rng(1).uniform(0, 1, (6, 6))])
    assert max(worst(some)) < 1e-11


@cache
def half_chords() -> tuple[np.ndarray, float]:
    """Return the linear equations of the four lag states of the center wing, (4, 6), and V/b, 1/s.

    The columns are A over the lag states, A over alpha, and E over the updraft. V is the speed and
    b the half chord. The model is linearized at 10 deg.
    """
    point = trim(UNSTEADY, usual_condition(UNSTEADY).at(10 * DEGREES))
    model = linearize(
        UNSTEADY, point, full=True, outputs=("alpha_air_center",), disturbances=("updraft_center",)
    )
    flow = float(point.states.speed) / (UNSTEADY.parameters["chord"].start / 2)
    rows = [model.states.index(f"{kind}_center_{i}") for kind in ("lag", "gust") for i in (1, 2)]
    return np.hstack(
        [model.A[rows][:, rows], model.A[rows][:, [model.states.index("alpha")]], model.E[rows]]
    ), flow


def response(kind: str, lag: Lag, k: np.ndarray) -> np.ndarray:
    """Return the complex lift of the center wing per unit angle, divided by the steady lift.

    The lift follows from the rows of the lag states in A and E.

    kind: "lag" for a change of alpha, else for a gust
    lag: shares of the two lag states in the lift
    k: reduced frequencies
    """
    table, flow = half_chords()
    rows, column = ([0, 1], 4) if kind == "lag" else ([2, 3], 5)
    A = table[np.ix_(rows, rows)]
    b = table[rows, column]
    steady = -np.linalg.solve(A, b)
    z = (
        np.array([np.linalg.solve(1j * frequency * flow * np.eye(2) - A, b) for frequency in k])
        / steady
    )
    return 1 - (1 - z) @ np.array(lag[0])


def theodorsen(k: np.ndarray) -> np.ndarray:
    """Return Theodorsen's function C(k) = H1 / (H1 + i H0), with Hankel functions of the second
    kind.
    """
    return special.hankel2(1, k) / (special.hankel2(1, k) + 1j * special.hankel2(0, k))


def sears(k: np.ndarray) -> np.ndarray:
    """Return Sears's function, with the phase of the gust referred to the leading edge."""
    of_the_middle = (special.j0(k) - 1j * special.j1(k)) * theodorsen(k) + 1j * special.j1(k)
    return of_the_middle * np.exp(-1j * k)


@pytest.mark.parametrize(
    ("kind", "of", "lag", "most"),
    [("lag", theodorsen, MOTION, 0.0144), ("gust", sears, GUST, 0.1173)],
)
def test_lags_approximate_theodorsen_and_sears(
    kind: str, of: Callable[[np.ndarray], np.ndarray], lag: Lag, most: float
) -> None:
    """Jones's two lags approximate the lift of an oscillation and of a gust so far, k = .05 to 2."""
    k = np.linspace(0.05, 2.0, 400)
    assert np.abs(response(kind, lag, k) - of(k)).max() == pytest.approx(most, rel=0.01)


@pytest.mark.parametrize("degrees", [11.0, 20.0])
def test_unsteady_trims_equal_quasi_steady_trims(degrees: float) -> None:
    """The inputs of a trim equal those with quasi-steady loads, finite span and downwash.

    The two lag states of each strip are equal. lag_tip_1 and gust_outer_1 are 0. Without finite
    span, the center elevator changes by more than 0.3 deg.
    """
    condition = usual_condition(UNSTEADY).at(degrees * DEGREES)
    whole = trim(UNSTEADY, condition)
    slow = trim(
        UNSTEADY.with_parameters(local_motion=0.0, apparent_mass=0.0, lift_lag=0.0, gust_lag=0.0),
        condition,
    )
    assert_allclose(whole.inputs, slow.inputs, rtol=1e-10, atol=1e-11)
    strips = {name: getattr(whole.states, name) for name in LAG_STATES}
    assert all(
        strips[f"lag_{name}_1"] == pytest.approx(strips[f"lag_{name}_2"], abs=1e-12)
        for name in ("center", "outer", "tail_center", "tail_outer")
    )
    assert strips["lag_tip_1"] == pytest.approx(0.0, abs=1e-12)
    assert strips["gust_outer_1"] == pytest.approx(0.0)
    infinite = trim(UNSTEADY.with_parameters(finite_span=0.0), condition)
    assert abs(infinite.inputs.elevator_center - whole.inputs.elevator_center) > 0.3 * DEGREES
