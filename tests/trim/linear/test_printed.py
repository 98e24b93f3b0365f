"""The bands of a linear model: whose they are, and what has none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hfa_model import Aircraft, Parameters
from hfa_model.parameters import ParameterSet
from hfa_support import BadInputError
from trim import entry_bands, find_operating_point, level_flight, linearize
from trim.linear.printed import Bands, bands_known

CONDITION = level_flight(np.radians(10.0))


def heavier(parameters: ParameterSet, factor: float) -> ParameterSet:
    """The same file, covariance and all, with another panel mass in it."""
    return replace(parameters, values=parameters.values._replace(panel_mass=factor * parameters.values.panel_mass))


def bands_of(parameters: ParameterSet, dynamics: str = "published") -> Bands:
    aircraft = Aircraft(parameters.values, dynamics)
    return entry_bands(parameters, CONDITION, linearize(aircraft, find_operating_point(aircraft, CONDITION)))


@pytest.mark.parametrize(("dynamics", "widest"), [("published", 9.02e-5), ("newton", 2.055e-3)])
def test_a_band_is_two_standard_errors_of_the_rounding(
    parameter_set: ParameterSet, dynamics: str, widest: float
) -> None:
    """sqrt(diag(J C J')), with J from differences of whole trims and models."""

    def entries(values: Parameters) -> np.ndarray:
        aircraft = Aircraft(values, dynamics)
        model = linearize(aircraft, find_operating_point(aircraft, CONDITION))
        return np.hstack([model.A, model.B])

    columns = []
    for name in parameter_set.identified:
        step = 1e-5 * getattr(parameter_set.values, name)
        high, low = (getattr(parameter_set.values, name) + side * step for side in (1, -1))
        there, back = (entries(parameter_set.values._replace(**{name: value})) for value in (high, low))
        columns.append((there - back) / (2 * step))
    jacobian = np.stack(columns, axis=-1)
    errors = np.sqrt(np.einsum("ijk,kl,ijl->ij", jacobian, parameter_set.covariance, jacobian))
    found = bands_of(parameter_set, dynamics)
    np.testing.assert_allclose(np.hstack([found.A, found.B]), 2 * errors, rtol=1e-3, atol=1e-9)
    assert found.A.max() == pytest.approx(widest, rel=1e-3)


def test_the_same_identification_elsewhere_has_the_same_bands(parameter_set: ParameterSet) -> None:
    elsewhere = heavier(parameter_set, 1 + 1e-9)
    assert bands_known(elsewhere)
    np.testing.assert_allclose(bands_of(elsewhere).A, bands_of(parameter_set).A, rtol=0.01, atol=1e-6)


@pytest.mark.parametrize("factor", [1.1, 1 + 1e-6])
def test_an_edited_copy_has_no_bands(parameter_set: ParameterSet, factor: float) -> None:
    with pytest.raises(BadInputError, match="bands are known for the identified parameters"):
        bands_of(heavier(parameter_set, factor))
