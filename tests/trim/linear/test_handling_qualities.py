"""Handling qualities of the F-16 and the Navion as printed, and by nonlinear trims."""

from __future__ import annotations

import math

import numpy as np
import pytest
from own_models import F16, NAVION, trimmed

from hfa_model import Aircraft
from hfa_support import Model
from trim import find_operating_point, level_model, linearize
from trim.linear.handling_qualities import handling_qualities
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint


def values(aircraft: Aircraft | Model, point: OperatingPoint) -> dict[str, float]:
    return {each.name: each.value for each in handling_qualities(aircraft, point)}


def n_per_alpha(model: Model, point: OperatingPoint, pitching: str, step: float = 1e-4) -> float:
    """By trims: alpha moved by the elevator until alpha and pitch rate rest, everything else held."""
    loads = []
    for side in (1, -1):
        held = {**point.states._asdict(), **point.inputs._asdict()}
        held["alpha"] += side * step
        for name, output in model.replaced.items():
            held[output] = model.outputs_at(list(held.values())[: len(model.states)], point.inputs, [output])[output]
            del held[name]
        del held["pitch_rate"], held[pitching]
        condition = TrimCondition(held, {"alpha": 0.0, "pitch_rate": 0.0}, model=model)
        found = find_operating_point(model, condition, point)
        loads.append(model.outputs_at(found.states, found.inputs, ["load_factor"])["load_factor"])
    return (loads[0] - loads[1]) / (2 * step)


@pytest.mark.parametrize(
    ("model", "roll", "spiral"), [(F16.with_parameters(xcg=0.3), -3.601, -0.0128), (NAVION, -8.435, -0.00877)]
)
def test_printed_modes_and_load_factors(model: Model, roll: float, spiral: float) -> None:
    """The modes are those of the books in test_own_models.py; roll and spiral are printed by Stevens and Lewis at 502
    ft/s, by Nelson in example 5.2."""
    point = trimmed(model)
    found, roots = values(model, point), {mode.name: mode.eigenvalue for mode in linearize(model, point).modes}
    for name in ("short period", "phugoid", "dutch roll"):
        assert found[f"{name} frequency"] == pytest.approx(abs(roots[name]), rel=1e-12)
        assert found[f"{name} damping"] == pytest.approx(-roots[name].real / abs(roots[name]), rel=1e-12)
    exact = n_per_alpha(model, point, "elevator")
    assert found["n/alpha"] == pytest.approx(exact, rel=1e-5)
    assert found["CAP"] == pytest.approx(found["short period frequency"] ** 2 / exact, rel=1e-5)
    assert found["roll time constant"] == pytest.approx(-1 / roll, rel=1e-3)
    assert found["spiral time to half"] == pytest.approx(-math.log(2) / spiral, rel=0.08)


def test_two_real_eigenvalues_have_the_frequency_of_their_product() -> None:
    """The short period of the HFA is real at 30 deg."""
    model = level_model(Aircraft(), float(np.radians(30.0)))
    roots = [mode.eigenvalue for mode in model.modes if mode.name.startswith("short period")]
    found = values(Aircraft(), model.point)
    assert len(roots) == 2
    assert found["short period frequency"] == pytest.approx(math.sqrt(abs(np.prod(roots))), rel=1e-12)
    assert "roll time constant" not in found
