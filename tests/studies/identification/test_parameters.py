"""Identification of aircraft with known parameters, and of matrices that no aircraft can have."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

import hfa
from hfa.paper import level_model
from hfa_model import INPUTS, LINEAR_STATES, VARIANTS, Parameters, load_parameters, published_models
from studies.identification.parameters import ALTERNATIVES, IDENTIFIED, ROUGH, fit, identify

pytestmark = pytest.mark.slow

MOVED = tuple(name for name in LINEAR_STATES if name not in ("pitch", "dihedral"))
ENTRIES = [("A", row, column) for row in MOVED for column in LINEAR_STATES] + [
    ("B", row, column) for row in MOVED for column in INPUTS
]


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


def changed(matrix, row, column):
    """Return the paper's matrices with 0.01 added to one entry of the pair at 5 deg."""
    at_15, at_5 = published_models()
    entries = getattr(at_5, matrix).copy()
    columns = LINEAR_STATES if matrix == "A" else INPUTS
    entries[LINEAR_STATES.index(row), columns.index(column)] += 0.01
    return at_15, replace(at_5, **{matrix: entries})


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


# Every eighth entry, to save time.
@pytest.mark.parametrize("matrix_row_column", ENTRIES[1::8], ids="-".join)
def test_one_changed_entry_prevents_a_fit(parameters, matrix_row_column):
    """If one printed entry at 5 deg is changed by 0.01, no parameters fit all entries: even in a search
    from the identified parameters, the sum of squares exceeds 5 times the one that rounding causes.
    """
    identified = np.array([getattr(parameters, name) for name in IDENTIFIED])
    # `noise` is added to the logarithms of `ROUGH`: the search starts at `identified`.
    from_rough = np.log(identified / list(ROUGH.values()))
    found = fit(changed(*matrix_row_column), VARIANTS["published"], noise=from_rough)
    assert found.sum_of_squares > 5 * found.expected_sum


@pytest.mark.parametrize(
    ("description", "variant"), [pytest.param(*each, id=each[0]) for each in ALTERNATIVES]
)
def test_each_departure_from_newton_is_needed(description, variant):
    """If a term of the published dynamics is replaced by Newton's, some entry cannot be fitted.

    The largest difference exceeds 1000 half units of the last printed digit.
    """
    found = fit(published_models(), variant)
    assert found.largest > 1000.0, description


def test_one_angle_determines_all_but_one_combination():
    """The printed matrices at one angle determine all parameters except for one combination of the
    constant and the sin² part of the pitch inertia, of which one angle shows only the sum.

    At the other angle, the fitted parameters therefore give all rows of A and B but that of the pitch
    rate, which has a wrong common factor.
    """
    for known, unknown in itertools.permutations(published_models()):
        fitted = fit([known], VARIANTS["published"])
        # Known to 1 %: a singular value s gives the standard error 1/(s √3).
        assert np.count_nonzero(fitted.singular_values * np.sqrt(3) > 100) == len(IDENTIFIED) - 1
        model = level_model(hfa.aircraft(parameters=fitted.parameters.values), unknown.dihedral)
        computed = np.hstack([model.A, model.B])
        print_ = np.hstack([unknown.A, unknown.B])
        errors = np.abs(computed - print_).max(axis=1) / np.abs(print_).max(axis=1)  # of each row
        pitch = LINEAR_STATES.index("pitch_rate")
        assert errors[pitch] > 0.1
        assert np.delete(errors, pitch).max() < 1e-5
        row, printed_row = computed[pitch], print_[pitch]
        factor = row @ printed_row / (row @ row)
        assert np.abs(factor * row - printed_row).max() < 1e-5 * np.abs(printed_row).max()


def test_the_released_constants_lie_within_two_standard_errors(parameter_set):
    """The constants of the released simulation are within two standard errors of the identified
    ones.
    """
    released = load_parameters("gibson-2011-simulation").values
    for name in IDENTIFIED:
        distance = abs(getattr(parameter_set.values, name) - getattr(released, name))
        assert distance <= 2.0 * parameter_set.standard_errors[name], name
