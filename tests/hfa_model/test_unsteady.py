"""The unsteady dynamics, compared with a derivation from energies and with the steady limit.

Lags of the lift are compared with the functions of Theodorsen and Sears.
"""

from functools import cache

import numpy as np
import pytest
from lagrangian import winds_of
from random_points import WINDS, random_points, rates_function
from scipy import special
from standard_air import density
from unsteady_energy import GUST, MOTION, derived_unsteady

from hfa import linearize, trim
from hfa_model import STATES, UNSTEADY
from trim import usual_condition

DEGREES = np.pi / 180
LAG_STATES = tuple(UNSTEADY.states)[len(STATES) :]
#: Parameters that are the shares, 0 to 1, of the unsteady effects.
EFFECTS = ("local_motion", "apparent_mass", "lift_lag", "gust_lag", "finite_span", "downwash_share")


def points(count, seed):
    """Return random states (with lag states), inputs and winds for `count` points.

    The ranges are wider than those of any trim.
    """
    rng, (states, inputs) = np.random.default_rng(seed), random_points(count, seed)
    lags = rng.uniform(-0.3, 0.3, (count, len(LAG_STATES)))
    winds = rng.uniform(-6, 6, (count, len(WINDS)))
    return list(zip(np.hstack([states, lags]), inputs, winds, strict=True))


def by_energies(x, u, p, w):
    """Return the rates by name from the second derivation."""
    seven, lags = derived_unsteady(x, u, density(x.altitude), p, winds_of(w))
    return {**seven._asdict(), **lags}


def test_rates_equal_those_from_energies():
    """The rates equal those of the Euler-Lagrange equations, whose energy includes that of the apparent mass.

    The test uses no effect, all effects, each effect alone, and random fractions of all effects.
    """
    computed, derived = (
        rates_function(UNSTEADY.layout, equations)
        for equations in (lambda *at: UNSTEADY.equations(*at)[0], by_energies)
    )
    fractions = np.random.default_rng(1).uniform(0, 1, (6, 6))
    effects = np.vstack([np.zeros(6), np.ones(6), np.eye(6), fractions])  # of the six `EFFECTS`
    indices = [list(UNSTEADY.parameters).index(name) for name in EFFECTS]
    for effect, (x, u, w) in zip(effects, points(len(effects), seed=5), strict=True):
        p = UNSTEADY.p.copy()
        p[indices] = effect
        expected = np.array(derived(x, u, p, w))
        assert (
            np.abs((np.array(computed(x, u, p, w)) - expected) / (1 + np.abs(expected))).max()
            < 1e-11
        )


@cache
def half_chords():
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


def response(kind, lag, k):
    """Return the complex lift of the center wing per unit angle, divided by the steady lift.

    The lift follows from the rows of the lag states in A and E.

    kind: "lag" for a change of alpha, else for a gust
    lag: the shares of the two lag states in the lift, and their rates, which are not used
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


def theodorsen(k):
    """Return Theodorsen's function C(k) = H1 / (H1 + i H0), with Hankel functions of the second
    kind.
    """
    return special.hankel2(1, k) / (special.hankel2(1, k) + 1j * special.hankel2(0, k))


def sears(k):
    """Return Sears's function, with the phase of the gust referred to the leading edge."""
    of_the_middle = (special.j0(k) - 1j * special.j1(k)) * theodorsen(k) + 1j * special.j1(k)
    return of_the_middle * np.exp(-1j * k)


@pytest.mark.parametrize(
    ("kind", "exact", "lag", "largest_error"),
    [("lag", theodorsen, MOTION, 0.0144), ("gust", sears, GUST, 0.1173)],
)
def test_lags_approximate_theodorsen_and_sears(kind, exact, lag, largest_error):
    """The largest error of two lags, relative to the steady lift, is 1.4 % for motion, by Theodorsen's
    function of an oscillation, and 12 % for gusts, by Sears's function.

    Reduced frequencies are .05 to 2. Another constant in `MOTION` or `GUST` would change the errors.
    """
    k = np.linspace(0.05, 2.0, 400)
    assert np.abs(response(kind, lag, k) - exact(k)).max() == pytest.approx(largest_error, rel=0.01)
