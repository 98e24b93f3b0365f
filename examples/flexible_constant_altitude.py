"""The paper's aircraft at 10 deg of dihedral, with six states and constant altitude.

hfa prove cost --aircraft examples/flexible_constant_altitude.py:FLEXIBLE --degree 2 --margin 0.1
"""

from __future__ import annotations

import math
from typing import Any

import hfa
from hfa_aircraft.about import Domain

_PAPER = hfa.aircraft("published")
_AT_TRIM = {name: value for name, value in _PAPER.trim.items() if name != "altitude"}


class _AtAltitude:
    """States of the aircraft, with the altitude of the paper's trim added."""

    altitude = _PAPER.trim["altitude"]

    def __init__(self, x: Any) -> None:
        self._x = x

    def __getattr__(self, name: str) -> Any:
        return getattr(self._x, name)


def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Return the derivatives of the six states, and the flight-path angle."""
    rates, outputs = _PAPER.equations(_AtAltitude(x), u, p, w)
    return {name: rates[name] for name in _PAPER.linear}, {"gamma": outputs["gamma"]}


def envelope(x: Any, p: Any) -> dict[str, tuple[float, float]]:
    """Return the paper's limits of each state about a trim, state -> (lowest, highest).

    The altitude is omitted.
    """
    limits = _PAPER.domain.limits_about(_AtAltitude(x), p)
    return {name: pair for name, pair in limits.items() if name != "altitude"}


FLEXIBLE = hfa.Model(
    "flexible aircraft with constant altitude",
    {name: _PAPER.states[name] for name in _PAPER.linear},
    _PAPER.inputs,
    equations,
    parameters=_PAPER.parameters,
    outputs={"gamma": _PAPER.outputs["gamma"]},
    trim=_AT_TRIM | {"dihedral": math.radians(10.0)},
    schedule="dihedral",
    replaced=_PAPER.replaced,
    domain=Domain(envelope=envelope),
)
