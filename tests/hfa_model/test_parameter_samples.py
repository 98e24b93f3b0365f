"""Random samples of the HFA's parameters and their published standard errors.

Entries of A and B that are printed exactly vary little.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hfa
from hfa import BadInputError, LinearModel, linearize, trim
from hfa.paper import level_flight
from hfa_model import LINEAR_STATES, STATES, Parameters, sample_parameters
from trim import entry_bands, trim_points

COUNT = 6000
DETERMINED = [STATES.index(name) for name in LINEAR_STATES]


@pytest.fixture(scope="module", params=[5.0, 15.0])
def at_angle(
    request: pytest.FixtureRequest, published_aircraft, parameter_set
) -> tuple[float, LinearModel, Any]:
    angle = float(np.radians(request.param))
    condition = level_flight(angle)
    model = linearize(published_aircraft, trim(published_aircraft, condition))
    return angle, model, entry_bands(parameter_set, condition, model)


def coverage(
    samples: np.ndarray, at_angle: tuple[float, LinearModel, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the spread of A and B of sampled aircraft, compared with the standard errors.

    For each entry that depends on a parameter, the result contains the fraction of samples within
    1.96 standard errors, and the standard deviation divided by the standard error.
    """
    angle, model, bands = at_angle
    values = np.hstack([np.full((len(samples), 1), angle), samples])
    flights = trim_points(hfa.aircraft(), ("dihedral", *Parameters._fields), values)
    assert (flights.status == 0).all()
    entries = np.concatenate(
        [flights.A[:, DETERMINED][:, :, DETERMINED], flights.B[:, DETERMINED]], axis=2
    )
    center = np.hstack([model.A, model.B])
    errors = np.hstack([bands.A, bands.B]) / 2
    moved = errors > 1e-12
    assert moved.sum() == 35
    inside = (np.abs(entries - center) <= 1.96 * errors).mean(axis=0)
    return inside[moved], entries.std(axis=0)[moved] / errors[moved]


def test_sampled_entries_vary_with_their_standard_errors(parameter_set: Any, at_angle) -> None:
    """Entries of A and B vary with their published standard errors."""
    samples = np.array(sample_parameters(parameter_set, COUNT, seed=0))
    inside, spread = coverage(samples, at_angle)
    assert np.all((inside > 0.94) & (inside < 0.96))
    np.testing.assert_allclose(spread, 1.0, atol=0.03)


def test_each_parameter_has_its_standard_error(parameter_set: Any) -> None:
    """The samples of an identified parameter have its standard error within 3 %, and its sign.

    The other parameters are constant.
    """
    samples = sample_parameters(parameter_set, COUNT, seed=1)
    table = np.array(samples)
    center = np.array(parameter_set.values)
    errors = parameter_set.standard_errors
    for name, column in zip(Parameters._fields, table.T, strict=True):
        if name in errors:
            assert column.std() == pytest.approx(errors[name], rel=0.03), name
        else:
            assert np.ptp(column) == 0.0, name
    np.testing.assert_array_equal(np.sign(table), np.broadcast_to(np.sign(center), table.shape))
    assert isinstance(samples[0], Parameters)


def test_unusable_sampling_arguments_are_refused(parameter_set: Any) -> None:
    """Parameters without covariance or with value 0, and wrong counts and seeds, are refused."""
    with pytest.raises(
        BadInputError, match="the parameters have no covariance, which random samples"
    ):
        sample_parameters(replace(parameter_set, covariance=np.zeros((0, 0))), 3, seed=0)
    zero = replace(parameter_set, values=parameter_set.values._replace(zero_lift_moment=0.0))
    with pytest.raises(BadInputError, match="zero_lift_moment is identified as 0"):
        sample_parameters(zero, 3, seed=0)
    assert len(sample_parameters(parameter_set, 1, seed=0)) == 1
    for count, seed, message in ((0, 0, "count is 0"), (3, -1, "seed is -1")):
        with pytest.raises(BadInputError, match=f"{message}; give a whole number of at least"):
            sample_parameters(parameter_set, count, seed)
