"""Doubts about a table of derivatives: usual mistakes of sign, mass and unit."""

from __future__ import annotations

import math
from collections.abc import Iterator

from hfa_aircraft.readers.derivatives.table import Table
from hfa_aircraft.rigid.aircraft import GRAVITY
from hfa_aircraft.rigid.atmosphere import air_at

#: Largest change of alpha for which the lift is compared with the weight, rad.
_ALPHA = 0.3
#: Ratio of lift and weight beyond which the mass is doubted; pounds as slugs are a factor 32.
_RATIO = 8.0
#: Usual slopes of the lift, 1/rad. Wings of small aspect ratio have about 1, thin airfoils 2 pi.
_LIFT_SLOPES = (0.3, 20.0)
#: Largest usual ratio of Cm_alpha and CL_alpha, chords.
_STATIC_MARGIN = 3.0


def doubts_about(table: Table) -> Iterator[str]:
    """Yield a sentence for each entry that is probably a mistake. None is refused."""
    derivatives = table.derivatives
    slope = derivatives["CL_alpha"]
    least, most = _LIFT_SLOPES
    if not least <= abs(slope) <= most:
        other = "per deg" if abs(slope) < least else "per rad"
        yield (
            f"CL_alpha is {slope:.3g} per rad, usual are 1 to 7; it may be given {other} "
            f"(a factor of {180.0 / math.pi:.1f})"
        )
    else:
        yield from _of_weight(table)
        margin = -derivatives["Cm_alpha"] / slope
        if abs(margin) > _STATIC_MARGIN:
            yield (
                f"Cm_alpha is {derivatives['Cm_alpha']:.3g} per rad, a static margin of "
                f"{margin:.2g} chords; it may be given per rad (a factor of {180.0 / math.pi:.1f})"
            )
    if derivatives["Cm_alpha"] > 0.0:
        yield (
            f"Cm_alpha is {derivatives['Cm_alpha']:.3g}, above 0: the aircraft is statically "
            "unstable, or the sign is wrong"
        )
    if derivatives.get("Cm_q", 0.0) == 0.0:
        yield "Cm_q is 0: the pitch rate is not damped, or the entry is missing"
    if derivatives.get("Cl_p", 0.0) > 0.0:
        yield (
            f"Cl_p is {derivatives['Cl_p']:.3g}, above 0: rolling is not damped, or the sign is "
            "wrong"
        )


def _of_weight(table: Table) -> Iterator[str]:
    """Yield a sentence if the lift at the stated condition is far from the weight."""
    values = table.values
    air = air_at(values.get("altitude", 0.0), table.system)
    pressure = 0.5 * float(air.density) * values["speed"] ** 2
    weight = values["mass"] * GRAVITY[table.system]
    carried = pressure * values["wing_area"] / weight
    lift = table.derivatives["CL_0"] * carried
    highest = lift + _ALPHA * abs(table.derivatives["CL_alpha"]) * carried
    if lift > _RATIO or highest < 1.0 / _RATIO:
        ratio = lift if lift > _RATIO else highest
        yield (
            f"the lift at {values['speed']:.4g} {table.unit('speed')} carries {ratio:.2g} times "
            "the weight; check the unit of the mass (1 slug = 32.17 lb)"
        )
