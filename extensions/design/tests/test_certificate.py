"""Clauses of the certificate of a generalized plant's controller, attacked by planted errors."""

from __future__ import annotations

import pytest
from plant_references import random_plant, smallest_of

from hfa import NoSolutionError
from hfa_design import GeneralizedPlant, closed_plant, solve_plant
from hfa_design.plant import generalized_plant
from hfa_design.plant.generalized_plant import central_controller


@pytest.mark.parametrize(
    "part", ["Ak", *(pytest.param(x, marks=pytest.mark.slow) for x in ("Bk", "Ck", "Dk"))]
)
def test_a_planted_controller_error_is_not_certified(
    monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    """A controller with one matrix wrong by 1 % (planted fault) is not certified."""

    def wrong(*arguments):
        parts = dict(zip(("Ak", "Bk", "Ck", "Dk"), central_controller(*arguments), strict=True))
        return tuple((1.01 if name == part else 1.0) * value for name, value in parts.items())

    plant = random_plant(8)
    delta = 1.001 * smallest_of(8).value
    # Planted fault: a controller with an error of 1 %.
    monkeypatch.setattr(generalized_plant, "central_controller", wrong)
    with pytest.raises(NoSolutionError, match="the controller is not certified: "):
        solve_plant(plant, delta)


def test_the_direct_part_is_the_central_completion() -> None:
    """D11 + D12 Dk D21 = [[a, b], [c, x]] with x = -c a b / (δ² - a²), in orthonormal bases."""
    plant = GeneralizedPlant(
        A=[[0.0, 1.0], [0.0, 0.0]], B1=[[0.0, 0.0], [1.0, 0.0]], B2=[[0.0], [1.0]],
        C1=[[1.0, 0.0], [0.0, 0.0]], D12=[[0.0], [1.0]], C2=[[1.0, 0.0]],
        D11=[[0.5, 0.3], [-0.4, 0.7]], D21=[[0.0, 0.1]], D22=[[0.2]],
    )  # fmt: skip
    found = solve_plant(plant, 2.0)
    *_, D = closed_plant(plant, (found.Ak, found.Bk, found.Ck, found.Dk))
    assert D.ravel() == pytest.approx([0.5, 0.3, -0.4, 0.4 * 0.5 * 0.3 / (4.0 - 0.25)])
