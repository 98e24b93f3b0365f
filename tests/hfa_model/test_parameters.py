"""Parameter files are restored bit for bit or refused in one line. Checks of the printed
matrices."""

from dataclasses import replace

import numpy as np
import pytest
from cli import refusal

from hfa_model import Parameters, load_parameters, save_parameters


def test_round_trip_is_bit_for_bit(tmp_path, parameter_set):
    """Parameters of extreme size and a covariance of rank one are saved and loaded bit for bit."""
    rng = np.random.default_rng(1)
    count = len(parameter_set.identified)
    awkward = Parameters(*(10.0 ** rng.uniform(-300, 300, len(Parameters._fields))).tolist())
    sizes = 10.0 ** rng.uniform(-150, 150, count)
    direction = rng.normal(size=count)
    correlated = np.outer(sizes, sizes) * np.where(np.eye(count), 1.0, 1 / 3)
    assert parameter_set.covariance.shape == (15, 15)
    for each in (
        parameter_set,
        replace(parameter_set, values=awkward, covariance=correlated),
        replace(parameter_set, covariance=np.outer(direction, direction)),
    ):
        save_parameters(each, tmp_path / "aircraft.toml", "A header.\nIts second line.")
        read = load_parameters(tmp_path / "aircraft.toml")
        assert (read.values, read.sources, read.notes) == (each.values, each.sources, each.notes)
        np.testing.assert_array_equal(read.covariance, each.covariance)


COVARIANCE = "[covariance] must list the identified parameters and be symmetric"


@pytest.mark.parametrize("size", [1.0, 1e100])
def test_a_covariance_with_a_negative_eigenvalue_is_refused(tmp_path, parameter_set, size):
    """A symmetric covariance with positive variances and a correlation of 2 is refused, also if a third
    parameter has 1e100 times the size, beside which the negative eigenvalue is below rounding.
    """
    covariance = np.eye(len(parameter_set.identified)) * 1e-6
    covariance[0, 1] = covariance[1, 0] = 2e-6
    covariance[2] *= size
    covariance[:, 2] *= size
    path = tmp_path / "indefinite.toml"
    save_parameters(replace(parameter_set, covariance=covariance), path, "")
    assert COVARIANCE in refusal(load_parameters, path)
