"""`hfa.prove_region`, the command as a Python function."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from as_proved import as_proved
from nominal import nominal_game
from pendulum_regions import VAN_DER_POL
from stored_certificates import read, stored

import hfa
from hfa_aircraft.model import Model
from hfa_prove.search.obstacles import Obstacles
from hfa_prove.search.region import region_of_certificate


def test_python_and_the_command_report_equal_regions(
    model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gain, or an object with K, becomes the policy, and the region is shown as by the command.

    A gain of another shape, another trim and an unstable loop are refused.
    """
    point = hfa.trim(model)
    solution = hfa.solve(nominal_game(point.linearize()))
    with pytest.raises(hfa.NoSolutionError, match="not Hurwitz"):
        hfa.prove_region(model, point, -solution.K)
    found = replace(
        region_of_certificate(as_proved(*read(stored("region"))), stored("region")["witness"]),
        obstacles=Obstacles((np.inf, None), {}, ()),
    )
    given: list[Any] = []

    def search(problem: Any, **settings: Any) -> Any:
        given.append((problem.loop.policy.K, settings))
        return found

    monkeypatch.setattr("hfa_prove.prove_region.proved_region", search)
    region = hfa.prove_region(model, point, solution, seconds=20.0)
    assert np.array_equal(given[0][0], solution.K)
    assert given[0][1] == {"degree": 2, "seconds": 20.0, "progress": None}
    hfa.prove_region(model, point, [[2.0, 1.0]], degree=4)
    assert given[1][0].tolist() == [[2.0, 1.0]]
    assert (given[1][1]["degree"], given[1][1]["seconds"]) == (4, 60.0)
    assert (region.rho, region.extents) == (found.rho, found.extents)
    assert repr(region).startswith("Proved: region of attraction of pendulum")
    with pytest.raises(hfa.BadInputError, match=r"give \(1, 2\)"):
        hfa.prove_region(model, point, np.ones((2, 2)))
    other = hfa.load_model(VAN_DER_POL)
    for wrong in (("pendulum", point), (model, "a trim"), (other, point)):
        with pytest.raises(hfa.BadInputError):
            hfa.prove_region(*wrong, solution)  # type: ignore[arg-type]
