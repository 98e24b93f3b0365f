"""Linear models: the printed matrices, uncertainty bands, and winds at each panel."""

import math

import numpy as np
import pytest
from known_models import released_simulation

import hfa
from hfa import Model, linearize, trim
from hfa.paper import level_flight, level_model
from hfa_model import LINEAR_STATES, published_models
from studies.identification.parameters import ASSUMED, IDENTIFIED
from trim import compare, entry_bands
from trim.linear.linearize import direct_disturbances

MODELS = published_models()
PRINTED = pytest.mark.parametrize(
    "published", MODELS, ids=lambda published: f"{published.dihedral_deg:g}deg"
)


def half_units(model, published):
    """Return the largest |computed - printed| of A and B, in half units of the last printed
    digit.
    """
    return max(abs(row.half_units) for row in compare(model, published))


@PRINTED
@pytest.mark.parametrize("name", [*IDENTIFIED, *ASSUMED])
def test_a_parameter_one_percent_off_is_detected(parameters, published, name):
    """If one parameter is changed by 1 %, some entry of A or B differs from the printed one by more than
    three half units of its last digit, within which all entries of the identified aircraft are.
    """
    wrong = hfa.aircraft(parameters=parameters._replace(**{name: getattr(parameters, name) * 1.01}))
    assert half_units(level_model(wrong, published.dihedral), published) > 3.0


# Error bands.

CONDITION = level_flight(np.radians(10.0))


def bands_of(parameters, dynamics="published"):
    aircraft = hfa.aircraft(dynamics, parameters.values)
    return entry_bands(parameters, CONDITION, linearize(aircraft, trim(aircraft, CONDITION)))


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_a_band_is_two_standard_errors(parameter_set, dynamics):
    """The half-width of a band is two standard errors, 2 sqrt(diag(J C J')).

    J is computed from differences of linear models. C is the covariance of the parameters.
    """

    def entries(values):
        aircraft = hfa.aircraft(dynamics, values)
        model = linearize(aircraft, trim(aircraft, CONDITION))
        return np.hstack([model.A, model.B])

    columns = []
    for name in parameter_set.identified:
        step = 1e-5 * getattr(parameter_set.values, name)
        high, low = (getattr(parameter_set.values, name) + side * step for side in (1, -1))
        there, back = (
            entries(parameter_set.values._replace(**{name: value})) for value in (high, low)
        )
        columns.append((there - back) / (2 * step))
    jacobian = np.stack(columns, axis=-1)
    errors = np.sqrt(np.einsum("ijk,kl,ijl->ij", jacobian, parameter_set.covariance, jacobian))
    bands = bands_of(parameter_set, dynamics)
    np.testing.assert_allclose(np.hstack([bands.A, bands.B]), 2 * errors, rtol=1e-3, atol=1e-9)


def test_only_the_identified_parameters_have_error_bands():
    """The report of a linear model has error bands of A from the covariance of the identified parameters;
    with another boom length, it has none.
    """
    model = hfa.aircraft()
    identified, changed = (
        hfa.linearize(each, hfa.trim(each, level_flight(np.radians(10.0))))
        for each in (
            model,
            model.with_parameters(boom_length=model.parameters["boom_length"].start * 1.01),
        )
    )
    bands = bands_of(hfa.paper.default_parameters())
    np.testing.assert_array_equal(identified.report().data["A_band"], bands.A)
    assert "A_band" not in changed.report().data


# Winds at each panel, compared with the released simulation.

#: Entries of the wind columns of SimVFA (B. Thomsen, 2018, data/VFA_trimData.mat) at 68 ft/s and 11
#: deg.
PEER = {
    "updraft_center": {
        "speed": 2.11937536e-02,
        "alpha": -4.49771578e-02,
        "pitch_rate": -3.63933427e-01,
    },
    "updraft_outer": {
        "speed": 4.01027033e-02,
        "pitch_rate": -1.55866503,
        "dihedral_rate": 4.77260822e-02,
    },
}


def point_of(aircraft, degrees=11.0, **given):
    return trim(aircraft, level_flight(math.radians(degrees), **given))


def test_vertical_wind_has_the_released_columns():
    """The columns of E of updrafts at the center and at the outer panels are those of the released
    simulation SimVFA, `PEER`, within 2e-8 of their largest entry.
    """
    # Columns of headwinds differ: the drag of the simulation follows the speed over ground, not
    # the airspeed. A vertical wind changes neither to first order in level flight.
    aircraft, altitude = released_simulation()
    point = point_of(aircraft, altitude=altitude)
    model = linearize(aircraft, point, disturbances=tuple(PEER))
    for name, column in zip(model.disturbances, model.E.T, strict=True):
        errors = [
            abs(column[LINEAR_STATES.index(row)] - value) for row, value in PEER[name].items()
        ]
        assert max(errors) <= 2e-8 * max(map(abs, PEER[name].values())), name


@pytest.mark.parametrize(
    ("disturbed", "kept", "has_columns"),
    [("height", ("v",), True), ("lag", ("v",), False), ("lag", ("v", "lag"), True)],
)
def test_winds_that_act_through_an_omitted_lag_have_no_columns(disturbed, kept, has_columns):
    """A gust that acts on the rate of a lag has no column in a linear model that omits the lag, because the
    column would lack its effect on v through the lag. With the lag kept, it has one.

    The height is no lag, as no trim balances its rate: a gust on it has a column.

    kept: states of the linear model
    """

    def equations(x, u, p, w):
        rates = {"v": u.f - x.v + x.lag - 0.01 * x.height, "lag": -x.lag, "height": x.v}
        return rates | {disturbed: rates[disturbed] + w.gust}, {}

    model = Model(
        "kite",
        {name: hfa.Signal() for name in ("v", "lag", "height")},
        {"f": hfa.Signal()},
        equations,
        disturbances={"gust": hfa.Signal()},
        trim={"v": 1.0, "height": 0.0},
        steady=("v", "lag"),
        linear=("v",),
    )
    assert direct_disturbances(trim(model), kept) == (("gust",) if has_columns else ())
