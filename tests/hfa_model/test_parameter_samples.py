"""Random samples of the HFA's parameters and their published standard errors."""

from dataclasses import replace

import numpy as np
import pytest

from hfa import BadInputError
from hfa_model import Parameters, sample_parameters


def test_each_parameter_has_its_standard_error(parameter_set):
    """Samples have the standard errors within 3 %, the correlations and the signs of the parameters.

    The parameters that were not identified are constant.
    """
    samples = sample_parameters(parameter_set, 6000, seed=1)
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
    drawn = table[:, [Parameters._fields.index(name) for name in parameter_set.identified]]
    sizes = np.sqrt(np.diag(parameter_set.covariance))
    known = parameter_set.covariance / np.outer(sizes, sizes)
    np.testing.assert_allclose(np.corrcoef(drawn.T), known, atol=0.05)


@pytest.mark.parametrize(
    ("change", "count", "seed", "says"),
    [
        ({"covariance": np.zeros((0, 0))}, 3, 0, "the parameters have no covariance"),
        ({"zero_lift_moment": 0.0}, 3, 0, "zero_lift_moment is identified as 0"),
        ({}, 0, 0, "count is 0; give a whole number of at least"),
        ({}, 3, -1, "seed is -1; give a whole number of at least"),
    ],
)
def test_unusable_arguments_are_refused(parameter_set, change, count, seed, says):
    """A missing covariance, a parameter 0, no samples and a negative seed are refused.

    change: covariance or parameters that differ from the identified set
    """
    covariance = change.get("covariance", parameter_set.covariance)
    values = {name: value for name, value in change.items() if name != "covariance"}
    parameters = replace(
        parameter_set, covariance=covariance, values=parameter_set.values._replace(**values)
    )
    with pytest.raises(BadInputError, match=says):
        sample_parameters(parameters, count, seed)
