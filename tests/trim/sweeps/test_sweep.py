"""A sweep in memory: what it says of a point without a trim, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import Aircraft
from hfa_support import BadInputError
from trim import SweepPlan, TrimError, find_operating_point, level_flight, sweep
from trim.sweeps.chunk import run_chunk


def test_a_sweep_and_a_trim_say_the_same(aircraft: Aircraft) -> None:
    """Which rates do not balance within the limits, which limits bind, and what balance would take beyond them."""
    result = sweep(aircraft, {"dihedral": [0.0, 0.2], "speed": [30.0, 50.0, 68.0], "altitude": [5_000.0, 40_000.0]})
    assert 4 < np.count_nonzero(~result.trimmed) < 12
    for reason, values in zip(result.reasons, result.values.tolist(), strict=True):
        condition = level_flight(**dict(zip(result.variables, values, strict=True)))
        if not reason:
            assert find_operating_point(aircraft, condition).status == "trimmed"
            continue
        with pytest.raises(TrimError) as caught:
            find_operating_point(aircraft, condition)
        assert reason == str(caught.value)
        assert ", would have to be " in reason


def test_what_balance_would_take_is_named(published_aircraft: Aircraft) -> None:
    """The numbers are those of the point that balances, checked in the aircraft's own equations."""
    (reason,) = sweep(published_aircraft, {"speed": [30.0], "dihedral": [0.1]}).reasons
    chunk = run_chunk(("speed", "dihedral"), np.array([[30.0, 0.1]]), published_aircraft.parameters, "published")
    rates = published_aircraft.rates(chunk.states[0], chunk.inputs[0])
    assert np.abs(rates).max() < 1e-9
    throttle, *deflections = chunk.inputs[0].tolist()
    outer, center, tips = np.degrees(deflections[1:])
    assert 0.0 < throttle < 200.0
    assert reason.startswith("no trim: these rates do not balance: pitch_rate by ")
    assert reason.endswith(
        f"(limits that bind: aileron_outer at its highest, 20 deg, would have to be {outer:.6g} deg; "
        f"elevator_center at its highest, 30 deg, would have to be {center:.6g} deg; "
        f"elevator_outer at its lowest, -30 deg, would have to be {tips:.6g} deg)"
    )


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({"dihedral": [5.0, 15.0]}, "dihedral is 286.479 deg; it must lie between -60 deg and 60 deg"),
        ({"dihedral": [0.1], "speed": [68.0, -5.0]}, "speed is -5 ft/s; it must lie between 1 ft/s and 500 ft/s"),
        ({"altitude": [4e4, float("nan")]}, "altitude is nan; give a finite number"),
    ],
)
def test_values_outside_their_limits_are_refused(
    published_aircraft: Aircraft, axes: dict[str, list[float]], words: str
) -> None:
    """Degrees where radians are meant, mostly. A single trim refuses them in the same words."""
    with pytest.raises(BadInputError, match=words):
        sweep(published_aircraft, axes)
    with pytest.raises(BadInputError, match=words):
        SweepPlan({name: tuple(values) for name, values in axes.items()}, published_aircraft.parameters, "published")
