"""Warnings about a table of derivatives: usual mistakes of sign, mass and unit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

from hfa_aircraft.readers.derivatives.names import LARGEST_LIFT
from hfa_aircraft.readers.derivatives.published import FIGURES, Values, unusual
from hfa_aircraft.readers.derivatives.table import DerivativeTable
from hfa_aircraft.rigid.aircraft import inertia_matrix, inertia_warning
from hfa_aircraft.rigid.atmosphere import air_at

#: Entries without which an aircraft moves differently, though it is read.
_NEEDED = ("Cm_q", "CY_beta", "Cl_beta", "Cl_p", "Cn_beta", "Cn_r")
#: Control -> the entry that it needs.
_NEEDED_OF = {"elevator": "Cm_elevator", "aileron": "Cl_aileron", "rudder": "Cn_rudder"}
#: Controls whose signs are free in files of AVL.
_FREE_SIGNS = ("aileron", "rudder")
#: Largest usual angle of attack, rad.
_LARGEST_USUAL_ALPHA = math.radians(60.0)
#: Largest usual lift coefficient without flaps, for tables without CL_max.
_USUAL_CL_MAX = 2.0
#: Ratio of lift and weight beyond which the mass is reported; pounds as slugs are a factor 32.
_MOST_LIFT_PER_WEIGHT = 8.0
#: Largest usual angle between the stated alpha and that of level flight without controls, rad.
_ALPHA_ERROR = math.radians(2.0)


def warnings_about(table: DerivativeTable, parameters: Mapping[str, float]) -> Iterator[str]:
    """Yield a sentence for each entry that is probably a mistake. None is refused.

    parameters: the parameters of the model, which may differ from the table, name -> value
    """
    _, most = table.thrust
    thrust = {"thrust": most} if math.isfinite(most) else {}
    entries = Values({**table.values, **table.derivatives, **thrust, **parameters})
    yield from table.warnings
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
    yield from _weight_warnings(table, entries)


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


def _weight_warnings(table: DerivativeTable, entries: Values) -> Iterator[str]:
    """Yield a sentence if lift, weight and alpha at the stated condition contradict each other."""
    air = air_at(table.values.get("altitude", 0.0), table.system)
    dynamic_pressure = 0.5 * float(air.density) * entries["speed"] ** 2
    weight = entries["mass"] * entries["gravity"]
    weight_coefficient = weight / (dynamic_pressure * entries["wing_area"])
    lift = entries["CL_0"]
    largest_lift = table.values.get(LARGEST_LIFT) or max(lift, _USUAL_CL_MAX)
    if lift > _MOST_LIFT_PER_WEIGHT * weight_coefficient:
        lift_ratio, which = lift / weight_coefficient, "lift"
    elif lift < 0.0:
        yield f"CL_0 is {lift:.3g}, below 0 in level flight; check its sign"
        return
    elif largest_lift < weight_coefficient:
        lift_ratio = largest_lift / weight_coefficient
        which = f"largest lift (CL {largest_lift:.3g})"
    else:
        yield from _alpha_warnings(entries, weight_coefficient)
        return
    yield (
        f"the {which} at {entries['speed']:.4g} {table.unit('speed')} carries {lift_ratio:.2g} "
        "times the weight; check the unit of the mass (1 slug = 32.17 lb), the speed and the "
        "altitude"
    )


def _alpha_warnings(entries: Values, weight_coefficient: float) -> Iterator[str]:
    """Yield a sentence if level flight needs another alpha than the stated one.

    weight_coefficient: lift coefficient that carries the weight at the stated speed and altitude
    """
    # No warning without a stated alpha (nan), or for an unusual CL_alpha (`_figure_warnings`).
    stated, slope = entries["alpha"], entries["CL_alpha"]
    change = (weight_coefficient - entries["CL_0"]) / slope if slope else 0.0
    if math.isfinite(stated) and abs(change) > _ALPHA_ERROR and not unusual("CL_alpha", slope):
        yield (
            f"level flight at the condition of the derivatives is at alpha "
            f"{math.degrees(stated + change):.3g} deg, the table has {math.degrees(stated):.3g}"
            " deg; CL_0, CD_0 and Cm_0 are those at this alpha, not at alpha 0; check them, the "
            "mass, the speed, the altitude and their units"
        )
