"""Reasons why an aircraft has no trim at a condition, stated in a pilot's terms."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.signals import AIRSPEEDS
from hfa_jsbsim.airframe import SLUG_TO_LB
from hfa_jsbsim.engines import EngineFile
from hfa_jsbsim.parts import Parts

#: (imposed values, freed names) -> all values by name at the solution, or None.
Solve = Callable[[Mapping[str, float], tuple[str, ...]], Mapping[str, float] | None]
#: Angles of attack at which the greatest lift is searched.
_ANGLES = np.radians(np.arange(-4.0, 40.5, 0.5))
#: Largest number of commands in a sentence.
_MOST = 3
_AIRSPEEDS = {"speed", *AIRSPEEDS}
#: Least unbalanced force that is reported, relative to the weight, and least angular acceleration,
#: rad/s².
_SOME = 1e-6


def explain(
    parts: Parts,
    inputs: Sequence[str],
    commands: Mapping[str, str],
    imposed: Mapping[str, float],
    solve: Solve,
) -> str:
    """Return one line with the reasons why no trim exists, or "" if no reason is found.

    The reasons are found by trims with other free variables.

    parts: content of the aircraft's files.
    inputs: names of the aircraft's inputs.
    commands: property of the files that nothing sets -> input.
    imposed: name -> value imposed by the trim condition.
    solve: function (held, free) -> values by name, or None. It solves the same condition with the
        values `held` imposed and the equations `free` dropped.
    """
    held = [name for name, own in commands.items() if own in imposed]
    advice = [f"--free {' or '.join(held[:_MOST])} solves for a command that no file sets"] * bool(
        held
    )
    if not set(inputs) - {*commands.values()}:
        return "; ".join(["no input of the pilot changes a force or a moment", *advice])
    throttles = [name for name in inputs if name.startswith("throttle") and name not in imposed]
    reasons = [*_of_thrust(parts, throttles, solve), *of_engine_files(parts)]
    if not (reasons or "elevator" in inputs or {*commands.values()} - {*imposed}):
        reasons = ["no input changes pitch_rate"]
    reasons = reasons or [*_of_lift(throttles, imposed, solve)] or [*_of_moment(solve)]
    return "; ".join([*reasons, *advice])


def _of_thrust(parts: Parts, throttles: Sequence[str], solve: Solve) -> Iterator[str]:
    """Yield a sentence on the thrust missing at full throttle, or on the excess thrust at idle."""
    full = None
    if parts.engines and throttles:
        full = solve(dict.fromkeys(throttles, 1.0), ("speed_dot",))
    if full is None:
        return
    mass = full["weight"] / SLUG_TO_LB
    least = _SOME * full["weight"]
    missing = -full["speed_dot"] * mass
    if missing > least:
        thrust = full["thrust"]
        powers = [value for name, value in full.items() if _is_power(name) and value > 0.0]
        power = f" from {len(powers)} x {powers[0]:.0f} hp" if powers else ""
        needed = thrust + missing
        yield (
            f"full throttle gives {thrust:.0f} lb{power}: {missing:.0f} of {needed:.0f} lb of "
            "thrust missing"
        )
        return
    idle = solve(dict.fromkeys(throttles, 0.0), ("speed_dot",))
    if idle is not None and idle["speed_dot"] * mass > least:
        yield f"at idle the thrust is {idle['speed_dot'] * mass:.0f} lb too large"


def _is_power(name: str) -> bool:
    """Return whether an output is the power of an engine, such as power0."""
    return name.startswith("power") and name.removeprefix("power").isdigit()


def _of_lift(throttles: Sequence[str], imposed: Mapping[str, float], solve: Solve) -> Iterator[str]:
    """Yield a sentence on the greatest lift at an imposed airspeed if it is below the weight."""
    if not _AIRSPEEDS & set(imposed):
        return
    balanced = _greatest_lift(throttles, solve, ("alpha_dot", "speed_dot"))
    if balanced is None or balanced.to_weight >= 1.0:
        return
    any_moment = _greatest_lift(throttles, solve, ("alpha_dot", "speed_dot", "pitch_rate_dot"))
    greatest = max(balanced, any_moment or balanced)
    what = "the greatest lift is"
    if greatest.to_weight >= 1.0:
        greatest = balanced
        what = "the elevator balances the pitching moment only up to a lift of"
    percent = f"{100.0 * greatest.to_weight:.0f} %"
    yield f"{what} {percent} of the weight, at alpha {math.degrees(greatest.alpha):.1f} deg"


class _Lift(NamedTuple):
    """Lift relative to the weight at an angle of attack, rad."""

    to_weight: float
    alpha: float


def _greatest_lift(throttles: Sequence[str], solve: Solve, free: tuple[str, ...]) -> _Lift | None:
    """Return the greatest lift at half throttle without the equations `free`, or None."""
    lifts = []
    for alpha in _ANGLES.tolist():
        values = solve({"alpha": alpha, **dict.fromkeys(throttles, 0.5)}, free)
        if values is not None:
            lifts.append(_Lift(values["lift_to_weight"], alpha))
    return max(lifts, default=None)


def _of_moment(solve: Solve) -> Iterator[str]:
    """Yield a sentence on the unbalanced pitching moment if all other equations have a solution."""
    for free in (("pitch_rate_dot",), ("pitch_rate_dot", "speed_dot")):
        values = solve({}, free)
        if values is not None:
            pitch = values["pitch_rate_dot"]
            if abs(pitch) > _SOME:
                yield f"the elevator cannot balance the pitching moment: {pitch:.3g} rad/s^2 remain"
            return


def of_engine_files(parts: Parts) -> Iterator[str]:
    """Yield sentences on the engine files that may explain missing power, each once."""
    reasons: dict[str, Any] = {}
    for file in parts.engines:
        for reason in _of_engine(file):
            reasons[reason] = None
    yield from reasons


def _of_engine(file: EngineFile) -> Iterator[str]:
    """Yield sentences on facts in an engine's file that may explain missing power.

    The facts are an empty tank, a turbine engine on a propeller, and an implausible
    propeller diameter.
    """
    name = file.engine.attributes.get("name", "") or file.mount.attributes.get("file", "an engine")
    if file.dry_of:
        yield (
            f"the file leaves the {file.dry_of} tank of {name} empty: unless --hold fills it, "
            "the trim is a glide"
        )
    if file.kind == "turbine_engine" and file.has_propeller:
        yield f"{name} is a turbine engine on a propeller; its thrust is interpreted as power"
    diameter = file.thruster.find("diameter")
    if not file.has_propeller or diameter is None or "unit" in diameter.attributes:
        return
    if diameter.number() > _LONGEST_BLADES:
        length = f"propeller diameter {diameter.number():.0f} ft"
        yield f"{diameter.where}: {length}, because the file gives no unit"


#: Larger propeller diameters are implausible, ft.
_LONGEST_BLADES = 40.0
