"""Warnings about a table of derivatives: usual mistakes of sign, mass and unit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

from hfa_aircraft.readers.derivatives.names import LARGEST_LIFT, TAIL_ARM
from hfa_aircraft.readers.derivatives.published import FIGURES, Values, unusual
from hfa_aircraft.readers.derivatives.table import DerivativeTable
from hfa_aircraft.rigid.aircraft import FORCE, GRAVITY, inertia_matrix, inertia_warning
from hfa_aircraft.rigid.atmosphere import air_at

#: Entries without which an aircraft moves differently, though it is read.
_NEEDED = ("Cm_q", "CY_beta", "Cl_beta", "Cl_p", "Cn_beta", "Cn_r")
#: Control -> the entry that it needs.
_NEEDED_OF = {"elevator": "Cm_elevator", "aileron": "Cl_aileron", "rudder": "Cn_rudder"}
#: Controls whose signs are free in files of AVL.
_FREE_SIGNS = ("aileron", "rudder")
#: Largest usual angle of attack, rad.
_LARGEST_USUAL_ALPHA = math.radians(60.0)
#: Range of the largest lift coefficient, with flaps and blowing.
_CL_MAX = (0.4, 5.0)
#: Largest usual factor between the tail arms that its forces and moments state.
_ARM_FACTOR = 1.7
#: Largest usual angle between the stated alpha and that of level flight without controls, rad.
_ALPHA_ERROR = math.radians(1.25)
#: The same where the table does not say whether its condition is that flight.
_LARGEST_ALPHA_ERROR = math.radians(14.0)


def warnings_about(table: DerivativeTable, parameters: Mapping[str, float]) -> Iterator[str]:
    """Yield a sentence for each entry that is probably a mistake. None is refused.

    parameters: the parameters of the model, which may differ from the table, name -> value
    """
    _, most = table.thrust
    thrust = {"thrust": most} if math.isfinite(most) else {}
    entries = Values({**table.values, **table.derivatives, **thrust, **parameters})
    yield from _angle_warnings(table)
    xx, yy, zz = (entries[name] for name in ("Ixx", "Iyy", "Izz"))
    products = (0.0, entries.get("Ixz", 0.0), 0.0)
    if warning := inertia_warning(inertia_matrix((xx, yy, zz), products)):
        yield warning
    yield from _figure_warnings(table, entries)
    needed = (*_NEEDED, *(_NEEDED_OF[name] for name in table.surfaces if name in _NEEDED_OF))
    if missing := [name for name in needed if not entries.get(name)]:
        yield f"{', '.join(missing)} missing or 0; no published aircraft has 0"
    not_zero = tuple(name for name, value in entries.items() if value)
    idle = [name for name in table.surfaces if not any(e.endswith(f"_{name}") for e in not_zero)]
    if idle:
        yield f"no derivative of {', '.join(idle)} is given: no effect on the aircraft"
    stated = Values({**table.values, **table.derivatives})
    yield from _weight_warnings(table, stated)
    yield from _tail_warnings(table, stated)
    largest = table.values.get(LARGEST_LIFT, 1.0)
    if not _CL_MAX[0] < largest < _CL_MAX[1]:
        yield f"CL_max is {largest:.3g}, of aircraft {_CL_MAX[0]:g} to {_CL_MAX[1]:g}; check it"


def _figure_warnings(table: DerivativeTable, entries: Values) -> Iterator[str]:
    """Yield a sentence for each figure outside those of published aircraft, with its entries."""
    # Left out are figures of entries that are named already or that the table declares as checked,
    # and figures that are 0: `warnings_about` names missing entries.
    named = {*table.checked}
    for figure, number in FIGURES.items():
        names = [name for name in re.findall(r"\w+", figure) if name in entries]
        # In a file of AVL (with a center), the user chooses the sign of a control.
        is_free = table.center is not None and any(name in figure for name in _FREE_SIGNS)
        value = number(entries)
        if is_free or value == 0.0 or not named.isdisjoint(names):
            continue
        if warning := unusual(figure, value):
            named |= {*names}
            given = ", ".join(f"{name} {entries[name]:.4g}" for name in names if name != figure)
            yield f"{warning} ({given})" if given else warning


def _angle_warnings(table: DerivativeTable) -> Iterator[str]:
    """Yield a sentence for each angle that was probably typed in degrees, without a unit."""
    angles = {"alpha": (abs(table.values.get("alpha", 0.0)), _LARGEST_USUAL_ALPHA)}
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


def _weight_warnings(table: DerivativeTable, entry: Values) -> Iterator[str]:
    """Yield a sentence if the lift at the condition of the derivatives does not carry the weight of
    the table there, up to a change of alpha. Changed parameters do not change this condition.
    """
    air = air_at(entry.get("altitude", 0.0), table.system)
    force = 0.5 * float(air.density) * entry["speed"] ** 2 * entry["wing_area"]
    lift, weight = entry["CL_0"] * force, entry["mass"] * GRAVITY[table.system]
    # With a stated alpha, or without a moment, the condition is a trim; else it may be alpha = 0.
    is_trim = "alpha" in entry or not entry.get("Cm_0", 0.0)
    most = _ALPHA_ERROR if is_trim else _LARGEST_ALPHA_ERROR
    slope = entry["CL_alpha"]
    change = (weight - lift) / (force * slope) if slope else 0.0
    if unusual("CL_alpha", slope) or not (abs(change) > most or lift < 0.0):
        return
    alpha, unit = entry.get("alpha", 0.0), FORCE[table.system]
    yield (
        f"lift = weight at the condition of the table: {lift:.4g} and {weight:.4g} {unit}, or "
        f"level flight at alpha {math.degrees(alpha + change):.3g} deg, not "
        f"{math.degrees(alpha):.3g} deg; CL_0, CD_0 and Cm_0 are those at this alpha; check them, "
        "the mass, the speed, the altitude and their units"
    )


def _tail_warnings(table: DerivativeTable, entry: Values) -> Iterator[str]:
    """Yield a sentence if the moments of the tail are not its forces times the stated arm."""
    for name in ("q", "elevator"):
        arm = -entry[f"Cm_{name}"] / (entry[f"CL_{name}"] or math.nan) * entry["chord"]
        ratio = arm / entry[TAIL_ARM]
        if ratio < 1.0 / _ARM_FACTOR or ratio > _ARM_FACTOR:  # nan is neither
            yield (
                f"Cm_{name} = -CL_{name} tail_arm / chord: the arm is {arm:.4g} "
                f"{table.unit('chord')}, of tail_arm {entry[TAIL_ARM]:.4g}; check signs and units"
            )
