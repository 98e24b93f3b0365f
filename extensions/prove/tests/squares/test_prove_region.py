"""`hfa.prove_region`, the command as a Python function."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
import pytest
from nominal import nominal_game
from pendulum_regions import VAN_DER_POL

import hfa
from hfa_aircraft.model import Model
from hfa_prove.search.region import proved_region


def _interrupted(region: Any) -> NoReturn:
    raise KeyboardInterrupt


def test_python_and_the_command_report_equal_regions(
    model: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A region proved in Python has extents around 0, a positive level and the command's title.

    A gain of another shape and an unstable loop are refused. The search ends at the first region.
    """

    def first(problem: Any, **settings: Any) -> Any:
        return proved_region(problem, ("squares",), save=_interrupted, **settings)

    monkeypatch.setattr("hfa_prove.prove_region.proved_region", first)
    point = hfa.trim(model)
    solution = hfa.solve(nominal_game(point.linearize()))
    region = hfa.prove_region(model, point, solution, seconds=20.0)
    assert region.rho > 0.0
    assert [low < 0.0 < high for low, high in region.extents.values()] == [True, True]
    assert repr(region).startswith("Proved: region of attraction of pendulum")
    with pytest.raises(hfa.BadInputError, match=r"give \(1, 2\)"):
        hfa.prove_region(model, point, np.ones((2, 2)))
    other = hfa.load_model(VAN_DER_POL)
    for wrong in (("pendulum", point), (model, "a trim"), (other, point)):
        with pytest.raises(hfa.BadInputError):
            hfa.prove_region(*wrong, solution)  # type: ignore[arg-type]
    with pytest.raises(hfa.NoSolutionError, match="not Hurwitz"):
        hfa.prove_region(model, point, -solution.K)
