"""What options mean together."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa

from hfa_support.jobs.store import open_store


def test_a_number_beside_random_samples_is_a_constant() -> None:
    result = hfa("sweep", "--dihedral", "15", "--speed", "60:70", "--samples", "10", "-o", "a.zarr", "--json")
    assert (result.code, json.loads(result.out)["points"]) == (0, 10)
    dihedral, speed = open_store(Path("a.zarr")).read("values").T
    np.testing.assert_array_equal(dihedral, np.full(10, np.radians(15.0)))
    assert len(set(np.floor(speed - 60.0))) == 10


def test_a_flight_takes_no_disturbance_as_the_solution_does() -> None:
    words = ("--dihedral", "15", "--delta", "inf", "--json")
    K = json.loads(hfa("solve", *words).out)["K"]
    flown = hfa("fly", *words, "--law", "exact", "--duration", "0.1")
    assert flown.code == 0
    np.testing.assert_allclose(json.loads(flown.out)["policy"]["K"], K, rtol=1e-9)


def test_too_little_memory_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trim.sweeps.points._newton", lambda *_, **__: np.empty(10**15))
    assert_refused(hfa("sweep", "--dihedral", "0:5:1"), 2, "not enough memory")
