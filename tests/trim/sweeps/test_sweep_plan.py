"""What a large sweep visits: any slice of it alone, and plans that are refused."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import Parameters
from hfa_support import BadInputError
from trim import Steps, SweepPlan


def test_a_plan_gives_any_slice_of_the_whole(parameters: Parameters) -> None:
    dihedrals = tuple(np.radians(np.linspace(0, 20, 7)).tolist())
    axes = {"dihedral": dihedrals, "speed": (25.0, 60.0, 68.0, 75.0)}
    plan = SweepPlan(axes, parameters, "published")
    whole = plan.values(0, plan.count)
    assert plan.count == 28
    assert np.array_equal(whole[10:13], plan.values(10, 13))
    assert np.array_equal(whole[:4, 1], [25.0, 60.0, 68.0, 75.0])
    samples = SweepPlan({"dihedral": (0.0, 0.3), "panel_mass": (8.0, 10.0)}, parameters, "newton", samples=64, seed=5)
    table = samples.values(0, 64)
    # A Latin hypercube has exactly one point in each of its 64 strata of each variable.
    for column, (low, high) in enumerate(samples.axes.values()):
        strata = np.floor((table[:, column] - low) / (high - low) * 64).astype(int)
        assert sorted(strata) == list(range(64))
    assert samples.identity != SweepPlan(samples.axes, parameters, "newton", samples=64, seed=6).identity


@pytest.mark.parametrize(
    ("axes", "samples", "complaint"),
    [
        ({}, 0, "nothing to sweep"),
        ({"wind": (1.0,)}, 0, "cannot sweep 'wind'"),
        ({"panel_mass": (-1.0, 2.0)}, 0, "must be positive"),
        ({"dihedral": (0.2, 0.1)}, 5, "lowest:highest"),
        ({"dihedral": (0.1, 0.2)}, 20_000_000, "samples is 20000000; it must lie between 0 and 10,000,000"),
        (
            {"dihedral": Steps(0.0, 1e-9, 123457), "speed": Steps(60.0, 1e-6, 10**4)},
            0,
            "has 1,234,570,000 points, at most 1,000,000,000",
        ),
    ],
)
def test_a_wrong_plan_says_what_is_wrong(parameters: Parameters, axes: dict, samples: int, complaint: str) -> None:
    with pytest.raises(BadInputError, match=complaint):
        SweepPlan(axes, parameters, "published", samples=samples)
    with pytest.raises(BadInputError, match="aristotle"):
        SweepPlan({"dihedral": (0.1, 0.2)}, parameters, "aristotle")


def test_steps_that_end_outside_the_limits_are_refused(parameters: Parameters) -> None:
    with pytest.raises(BadInputError, match=r"dihedral is 80\.2\d* deg; it must lie between -60 deg and 60 deg"):
        SweepPlan({"dihedral": Steps(0.0, 0.1, 15)}, parameters, "published")
