"""Results are values: copies are equal, a changed entry is not, and nobody is asked for the truth of an array."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from hfa_model import Aircraft
from trim import (
    LinearModel,
    OperatingPoint,
    TrimError,
    find_operating_point,
    level_flight,
    linearize,
)


@pytest.fixture(scope="module")
def model(published_aircraft: Aircraft, point: OperatingPoint) -> LinearModel:
    return linearize(published_aircraft, point)


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
