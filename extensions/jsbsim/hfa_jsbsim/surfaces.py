"""Surfaces as inputs where no steady-state relation to the pilot's commands exists."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import casadi as ca

from hfa_jsbsim.control_system import output_limits
from hfa_jsbsim.properties import SETTING, LoopError, Note, Properties, canonical, contains
from hfa_jsbsim.xml_file import Element

#: What a property has around its surface, such as mag-elevator-pos-rad.
_AROUND = re.compile("^mag-|(-pos)?(-rad|-deg|-norm)?$")


@dataclass(frozen=True)
class PilotInput:
    """Input of the pilot: symbol, unit and limits."""

    symbol: ca.SX
    unit: str = "1"
    limits: tuple[float, float] = (-1.0, 1.0)


def names_read_by(element: Element) -> list[str]:
    """Return the names of the properties that functions and tables of a section read.

    Names of angles, which end in -rad or -deg, come first: the first name of a surface determines
    the unit of its input.
    """
    names: dict[str, None] = {}
    pending = [element]
    while pending:
        part = pending.pop()
        pending += part.children
        if part.name in ("property", "p", "independentVar"):
            names[canonical(part.text.removeprefix("-"))] = None
    return sorted(names, key=lambda name: (not name.endswith(("-rad", "-deg")), name))


def use_surface_positions(
    names: Iterable[str], properties: Properties, inputs: dict[str, PilotInput]
) -> list[Note]:
    """Replace pilot commands by surface positions as inputs where no steady-state relation exists.

    The command of such a surface acts through an integrator or a closed loop. Other properties that
    depend on such a command receive their values for centered controls. Returns notes for the user.

    names: properties on which the aerodynamic forces depend
    inputs: inputs by name. A surface replaces the command of the same name.
    """
    positions: dict[str, PilotInput] = {}
    notes = []
    for name in names:
        loop = _loop_of(name, properties)
        if loop is None:
            continue
        surface = _AROUND.sub("", name.rpartition("/")[2])  # such as left-aileron
        key = surface.removeprefix("left-").removeprefix("right-").replace("-", "_")
        if key not in inputs:  # not a surface, or one without a pilot's command
            properties.centered(name, loop)
            continue
        sign = -1.0 if surface.startswith("right-aileron") else 1.0  # opposite to the left one
        if key not in positions:
            unit = "rad" if name.endswith(("-rad", "-deg")) else "1"
            limits = _limits(name, surface, properties, sign)
            positions[key] = PilotInput(ca.SX.sym(key), unit, limits)
            statement = "the input is the surface position"
            notes.append(Note(statement, f"{key} ({loop.cause})", loop.where, SETTING))
        _set_surface(name, surface, properties, sign * positions[key].symbol)
    inputs.update(positions)
    return notes


def _loop_of(name: str, properties: Properties) -> LoopError | None:
    """Return the error of a loop for which a property has no steady-state value, or None."""
    if properties.writer(name) is None:
        return None
    return properties.loop_in(properties.read(name, ""))


def _limits(name: str, surface: str, properties: Properties, sign: float) -> tuple[float, float]:
    """Return the limits of a surface input, as given by the component that sets the surface."""
    # Unknown limits are infinite. The limits of an angle are in rad.
    # sign: of the surface's position relative to the input
    for source in (name, f"fcs/{surface}-pos-rad", f"fcs/{surface}-pos-deg"):
        writer = properties.writer(source)
        if writer is not None and writer.component is not None:
            low, high = output_limits(writer.component)
            if source.endswith("-deg"):
                low = math.radians(low)
                high = math.radians(high)
            return (low, high) if sign > 0.0 else (-high, -low)
    return -math.inf, math.inf


def _set_surface(name: str, surface: str, properties: Properties, value: ca.SX) -> None:
    """Set the properties of a surface position in all its units, and of its magnitude."""
    if not name.endswith(("-rad", "-deg")):
        properties.replace({name: value})
        return
    in_degrees = value * (180.0 / math.pi)
    positions = {
        name: in_degrees if name.endswith("-deg") else value,
        f"fcs/{surface}-pos-rad": value,
        f"fcs/{surface}-pos-deg": in_degrees,
        f"fcs/mag-{surface}-pos-rad": ca.fabs(value),
    }
    properties.replace(positions)


def reach_throttles(properties: Properties, throttles: Mapping[int, ca.SX]) -> Iterator[Note]:
    """Set the throttle positions of engines to the inputs, with a note for the user, unless the
    control system derives them from the inputs.

    throttles: index of the engine -> symbol of the input
    """
    positions: dict[str, ca.SX] = {}
    for engine, throttle in throttles.items():
        name = f"fcs/throttle-pos-norm[{engine}]"
        position = properties.read(name, "")
        if not contains(position, throttle) or properties.loop_in(position):
            positions[name] = throttle
            statement = "the input is the throttle position; throttle-cmd-norm has no effect on"
            yield Note(statement, f"engine {engine}", rank=SETTING)
    if positions:
        properties.replace(positions)
