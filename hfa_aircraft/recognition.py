"""Recognition of an aircraft's states by their names and units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hfa_aircraft.signals import Signal

_ANGLE = ("rad", "deg")
_RATE = ("rad/s", "deg/s")
_LENGTH = ("ft", "m", "km")
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
    "altitude": (("altitude", "alt", "h", "height"), _LENGTH),
}
#: Usual word or symbol -> name of another variable in the models of this project.
_WORDS = {
    **dict.fromkeys(("n", "nz", "g", "g_load"), "load_factor"),
    **dict.fromkeys(("m", "mach_number", "ma"), "mach"),
    **dict.fromkeys(("fpa", "flight_path", "flight_path_angle", "climb"), "gamma"),
    **dict.fromkeys(("psi", "heading"), "yaw"),
    "psi_dot": "turn_rate",
    "omega": "turn_rate",
    **dict.fromkeys(("cas", "ias", "kias"), "kcas"),
    "eas": "keas",
}
#: Mode -> states that dominate it, and another mode whose states must exist.
_MODES = {
    "short period": (("alpha", "q"), "short period"),
    "phugoid": (("speed", "theta"), "short period"),
    "dutch roll": (("beta", "r"), "dutch roll"),
    "roll": (("p",), "dutch roll"),
    "spiral": (("phi",), "dutch roll"),
}


def recognized(states: Mapping[str, Signal]) -> dict[str, str]:
    """Return role -> name of each state recognized by name and unit.

    The roles are alpha, q, speed, theta, beta, p, r, phi and altitude. A state of a part, such as
    the body_speed of an FMU, has the role if no state has the name itself and no other part has
    one. Only an aircraft has an altitude: other models may have a height, but no speed and alpha.
    """
    found: dict[str, str] = {}
    for role, (names, units) in _RECOGNIZED.items():
        with_unit = [name for name, signal in states.items() if signal.unit in units]
        named = [name for name in with_unit if name.lower() in names]
        ends = tuple(f"_{name}" for name in names if len(name) > 1)
        of_parts = [name for name in with_unit if name.lower().endswith(ends)]
        if named or len(of_parts) == 1:
            found[role] = (named or of_parts)[0]
    if not {"speed", "alpha"} <= {*found}:
        found.pop("altitude", None)
    return found


def usual_modes(states: Mapping[str, Signal]) -> dict[str, tuple[str, ...]]:
    """Return the default modes of an aircraft, name of the mode -> states that dominate it.

    The modes are short period (alpha, q), phugoid (speed, theta), Dutch roll (beta, r), roll (p)
    and spiral (phi). A mode is omitted if one of its states is not recognized by name and unit.

    The phugoid also requires the states of the short period. A model that is not an aircraft may
    also have a speed and an angle. Roll and spiral also require the states of the Dutch roll.
    """
    found = recognized(states)
    modes: dict[str, tuple[str, ...]] = {}
    for mode, (roles, other_mode) in _MODES.items():
        other_roles, _ = _MODES[other_mode]
        if all(role in found for role in (*roles, *other_roles)):
            modes[mode] = tuple(found[role] for role in roles)
    return modes


def meant_by(word: str, states: Mapping[str, Signal]) -> str:
    """Return the variable that a usual word or symbol names: roll of "phi", or ""."""
    plain = word.lower()
    for role, state in recognized(states).items():
        if plain in _RECOGNIZED[role][0]:  # the names, which the units follow
            return state
    return _WORDS.get(plain, "")
