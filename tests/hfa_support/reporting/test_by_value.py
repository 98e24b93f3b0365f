"""Results are values: copies are equal, a changed entry is not, and nobody is asked for the truth of an array."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hfa_model import Aircraft, published_models
from hfa_model.parameters import ParameterSet
from trim import (
    LinearModel,
    OperatingPoint,
    TrimError,
    entry_bands,
    find_operating_point,
    level_flight,
    linearize,
    sweep,
)


@pytest.fixture(scope="module")
def model(published_aircraft: Aircraft, point: OperatingPoint) -> LinearModel:
    return linearize(published_aircraft, point)


@pytest.fixture(scope="module")
def results(published_aircraft: Aircraft, parameter_set: ParameterSet, model: LinearModel) -> dict[str, Any]:
    """One of each; the sweep has a point without a trim, and nan in its arrays."""
    return {
        "parameters": parameter_set,
        "print": published_models()[0],
        "model": model,
        "bands": entry_bands(parameter_set, level_flight(float(model.point.states.dihedral)), model),
        "sweep": sweep(published_aircraft, {"speed": [30.0, 68.0]}),
    }


@pytest.mark.parametrize("name", ["parameters", "print", "model", "bands", "sweep"])
def test_a_copy_is_equal_and_another_result_is_not(results: dict[str, Any], name: str) -> None:
    result = results[name]
    assert pickle.loads(pickle.dumps(result)) == result
    assert [other for other, value in results.items() if value == result] == [name]


def test_one_changed_entry_is_seen(model: LinearModel) -> None:
    A = model.A.copy()
    A[3, 1] += 1e-12
    assert replace(model, A=A) != model
    assert replace(model, A=A) == replace(model, A=A.copy())
    assert model != replace(model, states=model.states[::-1])
    assert replace(model, A=A[:5]) != model
    assert replace(model, A=np.full_like(A, np.nan)) == replace(model, A=np.full_like(A, np.nan))


def test_a_failed_trim_can_be_sent_too(published_aircraft: Aircraft) -> None:
    with pytest.raises(TrimError) as caught:
        find_operating_point(published_aircraft, level_flight(0.1, speed=30.0))
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.attempt) == (str(caught.value), caught.value.attempt)
