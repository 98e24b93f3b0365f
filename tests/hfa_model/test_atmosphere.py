"""Density and speed of sound in models, compared with the package `ambiance`."""

import pytest

import hfa
from hfa import BadInputError


@pytest.mark.parametrize("altitude", [65_001.0, -1.0, float("nan")])
def test_altitudes_outside_the_layers_are_refused(altitude):
    """An altitude outside 0 to 65,000 ft, or nan, raises BadInputError."""
    model = hfa.aircraft()
    point = hfa.trim(model)
    x = point.states._replace(altitude=altitude)
    with pytest.raises(BadInputError, match="from 0 to 65000 ft"):
        model.outputs_at(x, point.inputs)
