"""Identification of aircraft with known parameters, and of matrices that no aircraft can have."""

from dataclasses import replace

import numpy as np
import pytest

import hfa
from hfa.paper import level_model
from hfa_model import VARIANTS, Parameters, published_models
from studies.identification.parameters import ALTERNATIVES, IDENTIFIED, ROUGH, fit, identify

pytestmark = pytest.mark.slow


def made_up(parameters, rng):
    """Return random parameters: each identified parameter is multiplied by a factor in
    exp(±0.2).
    """
    factors = np.exp(rng.uniform(-0.2, 0.2, len(IDENTIFIED)))
    return parameters._replace(
        **{
            name: getattr(parameters, name) * factor
            for name, factor in zip(IDENTIFIED, factors.tolist(), strict=True)
        }
    )


def printed(parameters):
    """Return the matrices A and B of an aircraft at both printed angles, rounded as in the
    paper.
    """
    models = []
    for published in published_models():
        exact = level_model(hfa.aircraft(parameters=parameters), published.dihedral)
        A = 2 * published.half_unit_A * np.round(exact.A / (2 * published.half_unit_A))
        B = 2 * published.half_unit_B * np.round(exact.B / (2 * published.half_unit_B))
        models.append(replace(published, A=A, B=B))
    return models


def errors_in_standard_errors(found, truth):
    """Return the error of each identified parameter, divided by its standard error."""
    errors = found.parameters.standard_errors
    return np.array(
        [
            (getattr(found.parameters.values, name) - getattr(truth, name)) / errors[name]
            for name in IDENTIFIED
        ]
    )


@pytest.fixture(scope="module")
def identified():
    return identify(seed=0)


def test_all_initial_guesses_give_the_same_fit(identified):
    """Searches from `ROUGH` and seven random guesses about it lead to the same fit, although
    `ROUGH` is not near it. The errors of the 70 fitted entries are as small as rounding permits, with
    the largest below 1.5 half units of the last printed digit.
    """
    best, sums = identified
    assert len(sums) == 8
    np.testing.assert_allclose(sums, best.sum_of_squares, rtol=1e-6)
    rough = np.array(list(ROUGH.values()))
    fitted = np.array([getattr(best.parameters.values, name) for name in IDENTIFIED])
    assert np.median(np.abs(rough / fitted - 1)) > 0.1
    assert best.entries == 70
    assert best.sum_of_squares < 1.5 * best.expected_sum
    assert best.largest < 1.5


def test_known_aircraft_are_recovered_within_their_standard_errors(parameters):
    """The errors of the estimates of twenty known aircraft agree with the standard errors.

    The matrices are rounded as in the paper.
    """
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(20):
        truth = made_up(parameters, rng)
        found = fit(printed(truth), VARIANTS["published"])
        # Rounding is at most 1 half unit of the last printed digit, and the fit takes part of it.
        assert found.largest < 2.0
        rows.append(errors_in_standard_errors(found, truth))
        # The test can fail: 1 % of any constant is many standard errors.
        wrong = Parameters(*(1.01 * np.array(truth)).tolist())
        assert np.abs(errors_in_standard_errors(found, wrong)).min() > 5.0
    deviations = np.array(rows)
    assert np.abs(deviations).max() < 5.0
    # The mean is about 1. The mean of 20 squares of nearly uniform errors scatters by about 0.2. If
    # the standard errors were too small by a factor of sqrt(2), it would be 2.
    squares = (deviations**2).mean(axis=0)
    assert np.all((squares > 0.4) & (squares < 1.6)), dict(
        zip(IDENTIFIED, squares.round(2).tolist(), strict=True)
    )


@pytest.mark.parametrize(
    ("description", "variant"), [pytest.param(*each, id=each[0]) for each in ALTERNATIVES]
)
def test_each_departure_from_newton_is_needed(description, variant):
    """If a term of the published dynamics is replaced by Newton's, some entry cannot be fitted.

    The largest difference exceeds 1000 half units of the last printed digit.
    """
    found = fit(published_models(), variant)
    assert found.largest > 1000.0, description
