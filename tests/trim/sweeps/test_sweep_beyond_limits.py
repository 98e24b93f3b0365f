"""A point that balances beyond the limits: which variable is named, by what, how far."""

from __future__ import annotations

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, STATES
from trim.point.condition import LIMITS
from trim.sweeps.chunk import BEYOND_LIMITS, TRIMMED, run_chunk
from trim.sweeps.sweep import sweep

VARIABLES = ("speed", "gamma", "alpha")
#: Speed ft/s, gamma and alpha rad -> the variable farthest beyond its limits, in widths of them.
FARTHEST = {
    (68.0, 0.35, 0.0489): "throttle",
    (68.0, -0.35, 0.0489): "throttle",
    (30.0, 0.0, 0.0489): "elevator_center",
    (68.0, 0.0, 0.36): "elevator_center",  # the throttle by more, but by less of its width
    (68.0, 0.0, 0.0489): "",
}


def test_a_chunk_names_the_variable_farthest_beyond_its_limits(aircraft: Aircraft) -> None:
    chunk = run_chunk(VARIABLES, np.array(list(FARTHEST)), aircraft.parameters, aircraft.variant.name)
    names = STATES + INPUTS
    for i, expected in enumerate(FARTHEST.values()):
        assert chunk.status[i] == (BEYOND_LIMITS if expected else TRIMMED)
        assert chunk.limiting[i] == (names.index(expected) if expected else -1)
        values = dict(zip(names, [*chunk.states[i], *chunk.inputs[i]], strict=True))
        finite = {name: limits for name, limits in LIMITS.items() if np.isfinite(limits).all()}
        excess = {n: max(low - values[n], values[n] - high) / (high - low) for n, (low, high) in finite.items()}
        assert max(excess.values()) == excess[expected] > 0 if expected else max(excess.values()) <= 0


def test_a_sweep_says_which_limits_and_by_how_much(published_aircraft: Aircraft) -> None:
    """The numbers are those of the point that balances, checked in the aircraft's own equations."""
    (reason,) = sweep(published_aircraft, {"speed": [30.0], "dihedral": [0.1]}).reasons
    chunk = run_chunk(("speed", "dihedral"), np.array([[30.0, 0.1]]), published_aircraft.parameters, "published")
    rates = published_aircraft.rates(chunk.states[0], chunk.inputs[0])
    assert np.abs(rates).max() < 1e-9
    throttle, *deflections = chunk.inputs[0].tolist()
    outer, center, tips = np.degrees(deflections[1:])
    assert 0.0 < throttle < 200.0
    assert reason == (
        f"no trim within limits: aileron_outer would have to be {outer:.6g} deg, its highest is 20 deg; "
        f"elevator_center would have to be {center:.6g} deg, its highest is 30 deg; "
        f"elevator_outer would have to be {tips:.6g} deg, its lowest is -30 deg"
    )
