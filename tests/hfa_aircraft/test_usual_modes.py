"""Default names of the modes of an aircraft that declares none."""

from __future__ import annotations

from typing import Any

import pytest

from hfa import Model, Signal, linearize, sweep, trim

_UNITS = {
    "V": "ft/s",
    "alpha": "rad",
    "q": "rad/s",
    "theta": "rad",
    "beta": "rad",
    "p": "rad/s",
    "r": "rad/s",
    "phi": "rad",
}


def _rates(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the rates of a light jet with textbook derivatives, and no outputs.

    The derivatives outside the speed equation increase with speed.
    """
    k = x.V / 500.0
    rates = {
        "V": 20.0 * u.throttle - 10.0 * k**2 - 32.2 * (x.theta - x.alpha),
        "alpha": x.q - 0.8 * k * x.alpha - 0.064 * (k - 1.0),
        "q": -5.0 * k**2 * x.alpha - 1.2 * k * x.q - 8.0 * u.elevator,
        "theta": x.q,
        "beta": -0.2 * k * x.beta - x.r + 0.064 * x.phi,
        "p": -20.0 * k * x.beta - 3.0 * k * x.p + 0.5 * x.r,
        "r": 4.0 * k * x.beta - 0.4 * k * x.r,
        "phi": x.p,
    }
    return rates, {}


def _jet(units: dict[str, str]) -> Model:
    held = {"V": 500.0, "beta": 0.0, "p": 0.0, "r": 0.0, "phi": 0.0, "q": 0.0}
    states = {name: Signal(unit) for name, unit in units.items()}
    inputs = {"throttle": Signal("1"), "elevator": Signal("rad")}
    steady = ("V", "alpha", "q")
    return Model("jet", states, inputs, _rates, trim=held, steady=steady, schedule="V")


def test_linearize_and_sweep_give_equal_mode_names() -> None:
    """A mode has the same name in a sweep and in the linear model at each point.

    The names are those of the approximations of textbooks: the roll mode is near L_p = -3, the
    spiral slow, the Dutch roll near sqrt(N_beta), the short period faster than the phugoid.
    """
    model = _jet(_UNITS)
    speeds = [400.0, 500.0, 600.0]
    swept = sweep(model, {"V": speeds})
    for speed, eigenvalues in zip(speeds, swept.eigenvalues, strict=True):
        modes = linearize(model, trim(model, hold={"V": speed})).modes
        named = {mode.name: mode.eigenvalue for mode in modes}
        assert set(named) == {"short period", "phugoid", "dutch roll", "roll", "spiral"}
        k = speed / 500.0
        assert named["roll"] == pytest.approx(-3.0 * k, rel=0.3)
        assert abs(named["spiral"]) < 0.1
        assert named["dutch roll"].imag == pytest.approx(2.0 * k**0.5, rel=0.3)
        pitching = (k**2 * 5.0 + 0.96 * k**2) ** 0.5
        assert abs(named["short period"]) == pytest.approx(pitching, rel=0.1)
        assert abs(named["phugoid"]) < 0.2
        for name, value in zip(swept.mode_names, eigenvalues, strict=True):
            assert value in (
                pytest.approx(named[name]),
                pytest.approx(named[name].conjugate()),
            )
