"""Rotation of the air in gusts, as additional states of a model.

A gust that differs between nose and tail, or between the wing tips, has the effect of a rotation of
the air. With the white noise n that drives alpha, the pitch rate relative to the air is

    q - z / τ,   z' = -z / τ + n,   τ = 4 b / (π V).

b is the wing span, and V is the airspeed. z / τ is the time derivative of the gust through a
first-order lag. For the yaw rate, beta replaces alpha, and the rate is r + z / τ with
τ = 3 b / (π V). The roll rate of the air has an independent noise. The angular accelerations depend
on these relative rates. The lift due to the pitch rate of the air is neglected.

Source: MIL-F-8785C, 1980, section 3.7.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal

#: Name of the additional parameter, the logarithm of τ in s.
LAG = "turbulence_lag"
#: Value of τ at the start of the search, and its limits, s. At the upper limit the air does not
#: rotate.
BEGIN = 0.2
LIMITS = (0.02, 100.0)


@dataclass(frozen=True)
class Rotation:
    """Rotation of the air about one body axis.

    state: name of the state z that is added to the model.
    of: flow angle whose noise also drives z, or "" if z has its own noise.
    sign: sign of z / τ in the rate relative to the air.
    lag: τ / exp(`LAG`), where τ is the time constant of z. `LAG` is common to all axes.
    """

    state: str
    of: str
    sign: float
    lag: float


#: Angular rate of the aircraft -> rotation of the air.
ROTATIONS = {
    "roll_rate": Rotation("gust_roll", "", 1.0, 1.0),
    "pitch_rate": Rotation("gust_pitch", "alpha", -1.0, 1.0),
    "yaw_rate": Rotation("gust_yaw", "beta", 1.0, 0.75),
}


def rotations_of(model: Model) -> dict[str, Rotation]:
    """Return the rotations of the air that gusts cause, by angular rate of the model.

    A rotation is omitted if the model lacks the angular rate in rad/s or the flow angle in rad.
    """
    units = {name: signal.unit for name, signal in model.states.items()}
    return {
        rate: each
        for rate, each in ROTATIONS.items()
        if units.get(rate) == "rad/s" and (not each.of or units.get(each.of) == "rad")
    }


def in_rotating_air(model: Model) -> Model:
    """Return the model with the states of the air's rotation and the parameter `LAG`.

    A model for which `rotations_of` is empty is returned unchanged.
    """
    rotations = rotations_of(model)
    if not rotations:
        return model
    added = {each.state: Signal("rad", 0.01) for each in rotations.values()}
    return replace(
        model,
        states={**model.states, **added},
        steady=(*model.steady, *added),
        parameters={**model.parameters, LAG: Signal("1", 1.0)},
        equations=_InRotatingAir(model),
    )


@dataclass(frozen=True)
class _InRotatingAir:
    """Equations (x, u, p, w) -> (rates by state, outputs by name) of a model in rotating air."""

    model: Model  # model in air that does not rotate

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Any]:
        """Return rates by state and outputs by name."""
        layout = self.model.layout
        own = layout.record("p", [getattr(p, name) for name in self.model.parameters])
        states = {name: getattr(x, name) for name in self.model.states}
        lag = ca.exp(getattr(p, LAG))
        relative = dict(states)
        rates = {}
        for rate, each in rotations_of(self.model).items():
            rates[each.state] = -getattr(x, each.state) / (each.lag * lag)
            relative[rate] = states[rate] - each.sign * rates[each.state]
        moved, outputs = self.model.equations(layout.record("x", states.values()), u, own, w)
        turned, _ = self.model.equations(layout.record("x", relative.values()), u, own, w)
        rates |= {rate: turned[rate] for rate in rotations_of(self.model)}
        return {**moved, **rates}, outputs
