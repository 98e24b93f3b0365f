"""What several test files fly: the identified aircraft with either set of equations."""

from __future__ import annotations

import os

# Matrices of six rows gain nothing from threads; must be set before NumPy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest

from hfa_model.compiled import Aircraft
from hfa_model.parameters import Parameters, ParameterSet, default_parameters
from hfa_model.variants import VARIANTS


@pytest.fixture(scope="session")
def parameter_set() -> ParameterSet:
    return default_parameters()


@pytest.fixture(scope="session")
def parameters(parameter_set: ParameterSet) -> Parameters:
    return parameter_set.values


@pytest.fixture(scope="session", params=sorted(VARIANTS))
def aircraft(request: pytest.FixtureRequest, parameters: Parameters) -> Aircraft:
    """The identified aircraft, once with each set of equations."""
    return Aircraft(parameters, request.param)


@pytest.fixture(scope="session")
def published_aircraft(parameters: Parameters) -> Aircraft:
    return Aircraft(parameters, "published")
