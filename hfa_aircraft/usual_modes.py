"""Default names of modes, derived from the names and units of a model's states."""

from __future__ import annotations

from collections.abc import Mapping

from hfa_aircraft.signals import Signal

_ANGLE = ("rad", "deg")
_RATE = ("rad/s", "deg/s")
_SPEED = ("ft/s", "m/s", "kt", "kts", "knot", "km/h")
#: State -> names, in lower case, and units by which it is recognized.
_RECOGNIZED = {
    "alpha": (("alpha", "aoa", "angle_of_attack"), _ANGLE),
    "q": (("q", "pitch_rate"), _RATE),
    "speed": (("v", "vt", "u", "va", "tas", "speed", "airspeed", "velocity"), _SPEED),
    "theta": (("theta", "pitch", "pitch_angle"), _ANGLE),
    "beta": (("beta", "sideslip"), _ANGLE),
    "p": (("p", "roll_rate"), _RATE),
    "r": (("r", "yaw_rate"), _RATE),
    "phi": (("phi", "roll", "bank", "roll_angle", "bank_angle"), _ANGLE),
}
#: Mode -> states that dominate it, and another mode whose states must exist.
_MODES = {
    "short period": (("alpha", "q"), "short period"),
    "phugoid": (("speed", "theta"), "short period"),
    "dutch roll": (("beta", "r"), "dutch roll"),
    "roll": (("p",), "dutch roll"),
    "spiral": (("phi",), "dutch roll"),
}


def usual_modes(states: Mapping[str, Signal]) -> dict[str, tuple[str, ...]]:
    """Return the default modes of an aircraft, name of the mode -> states that dominate it.

    The modes are short period (alpha, q), phugoid (speed, theta), Dutch roll (beta, r), roll (p)
    and spiral (phi). A mode is omitted if one of its states is not recognized by name and unit.

    The phugoid also requires the states of the short period. A model that is not an aircraft may
    also have a speed and an angle. Roll and spiral also require the states of the Dutch roll.
    """
    found: dict[str, str] = {}
    for role, (names, units) in _RECOGNIZED.items():
        for name, signal in states.items():
            if name.lower() in names and signal.unit in units:
                found.setdefault(role, name)
    modes: dict[str, tuple[str, ...]] = {}
    for mode, (roles, beside) in _MODES.items():
        needed = (*roles, *_MODES[beside][0])
        if all(role in found for role in needed):
            modes[mode] = tuple(found[role] for role in roles)
    return modes
