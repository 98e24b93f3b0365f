"""Air that moves: one uniform updraft, or the wind at the center panel and at the outer panels.

The air moves by (-headwind, ±outward, -updraft) in north, east, down; the aircraft flies north, and outward is to the
right at the right panel, to the left at the left one. The aircraft flies in its plane of symmetry, so both outer panels
are in mirrored air: what differs between left and right rolls and yaws, and has no place in this model. For the same
reason the center panel has no wind from the side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

from hfa_model.vectors import Quantity


class Wind(NamedTuple):
    """Velocity of the air at a panel over ground, ft/s: upward, from ahead, toward the tips."""

    updraft: Quantity = 0.0
    headwind: Quantity = 0.0
    outward: Quantity = 0.0


class Winds(NamedTuple):
    """The wind at the center panel and at each outer panel.

    ground_drag: the drag takes the speed over ground, as the simulation released with Gibson et al. 2011 has it; else
    that of the aircraft through the air of the panel.
    """

    center: Wind
    outer: Wind
    ground_drag: bool = False


#: Air as the equations take it: a uniform updraft, ft/s, positive up (0.0 is still air), or the wind at each panel.
Air: TypeAlias = "Quantity | Winds"


class Disturbance(NamedTuple):
    """A wind with a name, ft/s: what it means, and the components of `Wind` that it moves at the two places."""

    meaning: str
    center: tuple[str, ...]
    outer: tuple[str, ...]


#: Name -> wind, the disturbances of a linear model.
DISTURBANCES: dict[str, Disturbance] = {
    "updraft": Disturbance("air that rises, the same at every panel", ("updraft",), ("updraft",)),
    "updraft_center": Disturbance("air that rises at the center panel", ("updraft",), ()),
    "updraft_outer": Disturbance("air that rises at both outer panels", (), ("updraft",)),
    "headwind": Disturbance("air from ahead, the same at every panel", ("headwind",), ("headwind",)),
    "headwind_center": Disturbance("air from ahead at the center panel", ("headwind",), ()),
    "headwind_outer": Disturbance("air from ahead at both outer panels", (), ("headwind",)),
    "outward_outer": Disturbance("air toward the tip at both outer panels", (), ("outward",)),
}
#: Unit of every disturbance.
DISTURBANCE_UNIT = "ft/s"


def winds_of(air: Air) -> Winds:
    """The wind at each panel of what the equations were given."""
    if isinstance(air, Winds):
        return air
    everywhere = Wind(updraft=air)
    return Winds(everywhere, everywhere)


def winds_named(names: Sequence[str], values: Sequence[Quantity], *, ground_drag: bool = False) -> Winds:
    """The sum of the named winds with these values, ft/s; `DISTURBANCES` has the names."""
    sums: tuple[dict[str, Quantity], dict[str, Quantity]] = {}, {}
    for name, value in zip(names, values, strict=True):
        found = DISTURBANCES[name]
        for place, components in zip(sums, (found.center, found.outer), strict=True):
            for component in components:
                place[component] = place[component] + value if component in place else value
    return Winds(Wind(**sums[0]), Wind(**sums[1]), ground_drag)
