"""Linear models identified from JSBSim flights compared with JSBSim's linearization."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jsbsim")
pytest.importorskip("hfa_identify")

from hfa import identify
from studies.jsbsim.identified import (
    CASES,
    begun,
    jsbsim_flights,
    jsbsim_slopes,
    linear_model,
    own_slopes,
    records,
)


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_bands_contain_the_derivatives_of_jsbsim(name: str) -> None:
    """More than 90 % of the 95 % bands contain the derivatives of JSBSim's linearization.

    The same is true for this project's linearization. No band of the pitch damping contains 1.1
    times the true value.
    """
    case = CASES[name]
    point, flights = jsbsim_flights(name, case)
    theirs, ours = jsbsim_slopes(name, point), own_slopes(point)
    model = linear_model(theirs, case.free)
    held = []
    for seed in (1, 3, 4, 5):
        rng = np.random.default_rng(seed)
        noisy = records(flights * case.repeated, rng)
        found = identify(begun(model, rng), noisy, case.free, inputs="steps")
        assert found.ok, found.first_line
        for slope, each in found.parameters.items():
            held += [each.low < value < each.high for value in (theirs[slope], ours[slope])]
        damping = found.parameters["pitch_rate__pitch_rate"]
        assert not damping.low < 1.1 * theirs["pitch_rate__pitch_rate"] < damping.high
    assert np.mean(held) > 0.9
