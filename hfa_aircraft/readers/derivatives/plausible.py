"""Doubts about a table of derivatives: usual mistakes of sign, mass and unit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from hfa_aircraft.readers.derivatives.names import LARGEST_LIFT
from hfa_aircraft.readers.derivatives.table import Table
from hfa_aircraft.rigid.aircraft import GRAVITY
from hfa_aircraft.rigid.atmosphere import air_at
from hfa_aircraft.rigid.motion import inertia_doubt

#: Largest usual angle of attack, rad.
_STEEPEST = math.radians(60.0)
#: Largest usual lift coefficient without flaps, for tables without CL_max.
_LARGEST_LIFT = 2.0
#: Ratio of lift and weight beyond which the mass is doubted; pounds as slugs are a factor 32.
_RATIO = 8.0
#: Largest usual angle between the stated alpha and that of level flight without controls, rad.
_OFF_ALPHA = math.radians(2.0)
#: Usual slopes of the lift, 1/rad. Wings of small aspect ratio have about 1, thin airfoils 2 pi.
_LIFT_SLOPES = (0.3, 20.0)
#: Least usual sizes of the damping of rolling and pitching, per rad of p b/2V and q c/2V.
_DAMPING = {"Cl_p": 0.03, "Cm_q": 0.3}
#: Usual ratios of the mean chord and area / span: 1 for a rectangular wing, 1.33 for a delta.
_CHORDS = (0.7, 2.0)
#: Largest usual drag coefficient without lift.
_MOST_DRAG = 1.0
#: Largest usual ratio of Cm_alpha and CL_alpha, chords.
_STATIC_MARGIN = 3.0


def doubts_about(table: Table) -> Iterator[str]:
    """Yield a sentence for each entry that is probably a mistake. None is refused."""
    yield from _of_angles(table)
    yield from _of_inertias(table)
    yield from _of_drag(table)
    yield from _of_chord(table)
    yield from _of_surfaces(table)
    yield from _of_lift_slope(table)
    yield from _of_static_stability(table)
    yield from _of_damping(table)


def _of_surfaces(table: Table) -> Iterator[str]:
    """Yield a sentence for surfaces without an effect, and for each of an unusual sign."""
    derivatives = table.derivatives
    idle = [name for name in table.surfaces if not _moves(name, derivatives)]
    if idle:
        yield f"no derivative of {', '.join(idle)} is given: no effect on the aircraft"
    signs = {"Cm_elevator": "pitches down"}
    if table.center is None:  # AVL files have signs of their own
        signs["Cn_rudder"] = "yaws left"
    for name, meaning in signs.items():
        if derivatives.get(name, 0.0) > 0.0:
            yield (
                f"{name} is {derivatives[name]:.3g}, above 0; a positive deflection usually "
                f"{meaning}; check the sign"
            )


def _of_lift_slope(table: Table) -> Iterator[str]:
    """Yield a sentence if the lift slope is unusual, otherwise those on weight and static margin,
    which depend on it.
    """
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


def _of_static_stability(table: Table) -> Iterator[str]:
    """Yield a sentence if the pitching moment increases with alpha."""
    slope = table.derivatives["Cm_alpha"]
    if slope > 0.0:
        yield (
            f"Cm_alpha is {slope:.3g}, above 0: the aircraft is statically unstable, or the sign "
            "is wrong"
        )


def _of_damping(table: Table) -> Iterator[str]:
    """Yield a sentence for each rate that is not damped, or only weakly."""
    derivatives = table.derivatives
    if derivatives.get("Cm_q", 0.0) == 0.0:
        yield "Cm_q is 0: the pitch rate is not damped, or the entry is missing"
    for name, least in _DAMPING.items():
        if 0.0 < -derivatives.get(name, 0.0) < least:
            yield (
                f"{name} is {derivatives[name]:.3g}, a weak damping; derivatives of rates are per "
                'rad, with per = "deg" too: multiply those per deg by 57.3'
            )
    if derivatives.get("Cl_p", 0.0) > 0.0:
        yield (
            f"Cl_p is {derivatives['Cl_p']:.3g}, above 0: rolling is not damped, or the sign is "
            "wrong"
        )


def _moves(surface: str, derivatives: Mapping[str, float]) -> bool:
    """Return whether a derivative with respect to a control surface is not 0."""
    return any(name.endswith(f"_{surface}") and value for name, value in derivatives.items())


def _of_angles(table: Table) -> Iterator[str]:
    """Yield a sentence for each angle that was probably typed in degrees, without a unit."""
    angles = {"alpha": (abs(table.values.get("alpha", 0.0)), _STEEPEST)}
    angles |= {
        name: (max(map(abs, limits)), math.pi)
        for name, limits in table.surfaces.items()
        if all(map(math.isfinite, limits))
    }
    for name, (size, most) in angles.items():
        if size > most:
            yield (
                f"{name} is {size:.4g} rad = {math.degrees(size):.4g} deg; angles without a unit "
                f'are in rad: "{size:.4g} deg"'
            )


def _of_inertias(table: Table) -> Iterator[str]:
    """Yield a sentence if no rigid body has the inertias."""
    names = ("Ixx", "Iyy", "Izz", "Ixz")
    xx, yy, zz, xz = (table.values.get(name, 0.0) for name in names)
    doubt = inertia_doubt([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
    if doubt:
        yield doubt


def _of_drag(table: Table) -> Iterator[str]:
    """Yield a sentence if the drag at the condition of the derivatives is negative."""
    induced = table.derivatives.get("CD_CL2", 0.0)
    drag = table.derivatives["CD_0"] + induced * table.derivatives["CL_0"] ** 2
    if drag < 0.0:
        yield f"the drag coefficient at the condition of the derivatives is {drag:.4g}, below 0"
    if table.derivatives["CD_0"] > _MOST_DRAG:
        yield f"CD_0 is {table.derivatives['CD_0']:.4g}; a count of drag is 0.0001"


def _of_chord(table: Table) -> Iterator[str]:
    """Yield a sentence if the mean chord is not about the area divided by the span."""
    chord, mean = table.values["chord"], table.values["wing_area"] / table.values["span"]
    least, most = _CHORDS
    if not least <= chord / mean <= most:
        yield (
            f"chord is {chord:.4g} {table.unit('chord')}, wing_area / span is {mean:.4g}; check "
            "these entries and their units"
        )


def _of_weight(table: Table) -> Iterator[str]:
    """Yield a sentence if the lift at the stated condition is far above the weight, if the largest
    lift is below it, or if level flight at this condition has another alpha.
    """
    values = table.values
    air = air_at(values.get("altitude", 0.0), table.system)
    pressure = 0.5 * float(air.density) * values["speed"] ** 2
    weight = values["mass"] * GRAVITY[table.system]
    carried = pressure * values["wing_area"] / weight
    coefficient = table.derivatives["CL_0"]
    largest = values.get(LARGEST_LIFT) or max(coefficient, _LARGEST_LIFT)
    share, which = carried * coefficient, "lift"
    if share <= _RATIO:
        share, which = carried * largest, f"largest lift (CL {largest:.3g})"
        if share >= 1.0:
            yield from _of_alpha(table, 1.0 / carried - coefficient)
            return
    yield (
        f"the {which} at {values['speed']:.4g} {table.unit('speed')} carries {share:.2g} times "
        "the weight; check the unit of the mass (1 slug = 32.17 lb)"
    )


def _of_alpha(table: Table, missing: float) -> Iterator[str]:
    """Yield a sentence if the lift coefficient that is missing at the stated alpha changes alpha
    too much. A table without alpha has no doubt.
    """
    stated = table.values.get("alpha", math.nan)
    off = missing / table.derivatives["CL_alpha"]
    if math.isfinite(stated) and abs(off) > _OFF_ALPHA:
        yield (
            f"level flight at the condition of the derivatives is at alpha "
            f"{math.degrees(stated + off):.3g} deg, the table has {math.degrees(stated):.3g} deg; "
            "CL_0, CD_0 and Cm_0 are those at this alpha, not at alpha 0; check them, the mass, "
            "the speed and their units"
        )
