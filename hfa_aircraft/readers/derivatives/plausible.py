"""Doubts about a table of derivatives: usual mistakes of sign, mass and unit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from hfa_aircraft.readers.derivatives.names import INDUCED, LARGEST_LIFT
from hfa_aircraft.readers.derivatives.table import Table
from hfa_aircraft.rigid.atmosphere import air_at
from hfa_aircraft.rigid.motion import inertia_doubt

#: Value of an entry that may be missing (nan), in the units of the table.
_Values = Callable[[str], float]


class _Usual(NamedTuple):
    """A dimensionless number of an aircraft with the range that real aircraft keep.

    number: its value from the entries; nan if it is unknown
    least, most: the range
    says: sentence on a value outside
    """

    number: Callable[[_Values], float]
    least: float
    most: float
    says: str


def _radius(moment: str) -> Callable[[_Values], float]:
    """Return the function from entries to the radius of gyration of a moment of inertia, in spans.

    The radius is nan for a moment that is not positive, which `inertia_doubt` names.
    """
    return lambda of: math.sqrt(max(of(moment), 0.0) / of("mass")) / of("span") or math.nan


_INERTIAS = "check the inertias and the mass, and their units (1 slug = 32.17 lb)"
_PER_DEGREE = "it may be given per deg (a factor of 57.3)"
_PER_RADIAN = "it may be given per rad (a factor of 57.3)"
#: Slope -> its usual sizes, per rad.
_SLOPES = {"CL_alpha": (1.0, 7.0), "Cm_elevator": (0.3, 3.0)}
#: A slope this factor outside is nearer, by ratio, to usual ones in the other unit of angles.
_OUTSIDE = math.sqrt(math.degrees(1.0))
_RATES = (
    'a weak damping; derivatives of rates are per rad, with per = "deg" too: multiply those per '
    "deg by 57.3"
)


def _doubt_of_slope(name: str, of: _Values) -> str:
    """Return a sentence if a slope was probably given in the other unit of angles, or ""."""
    size, (least, most) = abs(of(name)), _SLOPES[name]
    if least / _OUTSIDE <= size <= most * _OUTSIDE or math.isnan(size):
        return ""
    other = _PER_DEGREE if size < least else _PER_RADIAN
    return f"{name} is {size:.3g} per rad, usual are {least:g} to {most:g}; {other}"


#: Aspect ratios are those from lifting bodies to human-powered aircraft. A mean chord is area /
#: span for a rectangular wing, and 1.33 times as long for a delta. Wings of small aspect ratio have
#: a slope of the lift of about 1, thin airfoils of 2 pi. Radii of gyration are a half of those of
#: fighters to three times those of transports. A yawing moment of inertia is nearly the sum of the
#: others for a flat body.
_RANGES = (
    _Usual(
        lambda of: of("span") ** 2 / of("wing_area"), 0.5, 60.0,
        "span^2 / wing_area, the aspect ratio, is {:.3g}; check wing_area, span and chord",
    ),
    _Usual(
        lambda of: of("chord") * of("span") / of("wing_area"), 0.7, 2.0,
        "chord is {:.3g} times wing_area / span; check these entries and their units",
    ),
    _Usual(_radius("Ixx"), 0.03, 0.35, f"sqrt(Ixx / mass) is {{:.3g}} spans; {_INERTIAS}"),
    _Usual(_radius("Iyy"), 0.01, 0.9, f"sqrt(Iyy / mass) is {{:.3g}} spans; {_INERTIAS}"),
    _Usual(_radius("Izz"), 0.04, 1.0, f"sqrt(Izz / mass) is {{:.3g}} spans; {_INERTIAS}"),
    _Usual(
        lambda of: of("Izz") / of("Ixx") if of("Ixx") > 0.0 else math.nan, 1.0, math.inf,
        "Izz is {:.3g} times Ixx, and usually larger; they may be exchanged",
    ),
    _Usual(
        lambda of: of("Izz") / (of("Ixx") + of("Iyy")), 0.6, math.inf,
        "Izz is {:.3g} times Ixx + Iyy, usually nearly as large; check their units",
    ),
    _Usual(lambda of: of("CL_0"), -0.1, math.inf, "CL_0 is {:.3g}, below 0; check its sign"),
    _Usual(lambda of: of("CD_0"), -math.inf, 1.0, "CD_0 is {:.4g}; a count of drag is 0.0001"),
    _Usual(
        lambda of: of("CD_0") + (0.0 if math.isnan(of(INDUCED)) else of(INDUCED)) * of("CL_0") ** 2,
        0.0, math.inf,
        "the drag coefficient at the condition of the derivatives is {:.4g}, below 0",
    ),
    _Usual(
        lambda of: 0.0 if _doubt_of_slope("CL_alpha", of) else -of("Cm_alpha") / of("CL_alpha"),
        -3.0, 3.0,
        f"Cm_alpha is that of a static margin of {{:.2g}} chords; {_PER_RADIAN}",
    ),
    _Usual(
        lambda of: max(abs(of("CY_beta")) / 3.0, abs(of("Cl_beta")), abs(of("Cn_beta"))), 0.01,
        math.inf,
        "CY_beta, Cl_beta and Cn_beta are at most {:.2g} per rad; they may be given per deg (a "
        "factor of 57.3)",
    ),
    _Usual(
        lambda of: of("Cl_beta"), -math.inf, 0.01,
        "Cl_beta is {:.3g}, above 0: sideslip rolls into the wind, or the sign is wrong",
    ),
    _Usual(
        lambda of: -of("Cl_p") if of("Cl_p") < 0.0 else math.nan, 0.03, math.inf,
        f"Cl_p is -{{:.3g}}, {_RATES}",
    ),
    _Usual(
        lambda of: -of("Cm_q") if of("Cm_q") < 0.0 else math.nan, 0.3, math.inf,
        f"Cm_q is -{{:.3g}}, {_RATES}",
    ),
)  # fmt: skip
#: Derivative -> its usual sign, and what the other one means.
_SIGNS = {
    "CL_alpha": (1.0, "the lift decreases with alpha, or the sign is wrong"),
    "Cm_alpha": (-1.0, "the aircraft is statically unstable, or the sign is wrong"),
    "Cm_q": (-1.0, "pitching is not damped, or the sign is wrong"),
    "Cl_p": (-1.0, "rolling is not damped, or the sign is wrong"),
    "Cn_r": (-1.0, "yawing is not damped, or the sign is wrong"),
    "CY_beta": (-1.0, "the side force increases the sideslip, or the sign is wrong"),
    "Cm_elevator": (-1.0, "a positive deflection usually pitches down; check the sign"),
}
#: The same of controls whose signs are free in files of AVL.
_SIGNS_OF_CONTROLS = {
    "Cn_rudder": (-1.0, "a positive deflection usually yaws left; check the sign"),
    "Cl_aileron": (1.0, "a positive deflection usually rolls right; check the sign"),
}
#: Largest usual angle of attack, rad.
_STEEPEST = math.radians(60.0)
#: Largest usual lift coefficient without flaps, for tables without CL_max.
_LARGEST_LIFT = 2.0
#: Ratio of lift and weight beyond which the mass is doubted; pounds as slugs are a factor 32.
_RATIO = 8.0
#: Largest usual angle between the stated alpha and that of level flight without controls, rad.
_OFF_ALPHA = math.radians(2.0)


def doubts_about(table: Table, parameters: Mapping[str, float]) -> Iterator[str]:
    """Yield a sentence for each entry that is probably a mistake. None is refused.

    parameters: the parameters of the model, which may differ from the table, name -> value
    """
    values = {**table.values, **table.derivatives, **parameters}

    def of(name: str) -> float:
        """Return the value of an entry, nan if it is missing."""
        return values.get(name, math.nan)

    yield from table.doubts
    yield from _of_angles(table)
    if doubt := _of_inertias(of):
        yield doubt
    for usual in _RANGES:
        number = usual.number(of)
        if number < usual.least or number > usual.most:
            yield usual.says.format(number)
    yield from filter(None, (_doubt_of_slope(name, of) for name in _SLOPES))
    signs = _SIGNS if table.center is not None else {**_SIGNS, **_SIGNS_OF_CONTROLS}
    for name, (sign, meaning) in signs.items():
        if sign * of(name) < 0.0:
            yield f"{name} is {of(name):.3g}, {'above' if sign < 0.0 else 'below'} 0: {meaning}"
    if not values.get("Cm_q"):
        yield "Cm_q is 0: the pitch rate is not damped, or the entry is missing"
    idle = [name for name in table.surfaces if not _moves(name, values)]
    if idle:
        yield f"no derivative of {', '.join(idle)} is given: no effect on the aircraft"
    yield from _of_weight(table, of)


def _moves(surface: str, values: Mapping[str, float]) -> bool:
    """Return whether a derivative with respect to a control surface is not 0."""
    return any(name.endswith(f"_{surface}") and value for name, value in values.items())


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


def _of_inertias(of: _Values) -> str:
    """Return a sentence if no rigid body has the inertias, or ""."""
    xx, yy, zz, xz = (of(name) for name in ("Ixx", "Iyy", "Izz", "Ixz"))
    xz = 0.0 if math.isnan(xz) else xz
    return inertia_doubt([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])


def _of_weight(table: Table, of: _Values) -> Iterator[str]:
    """Yield a sentence if lift, weight and alpha at the stated condition contradict each other.

    The lift is far above the weight, the largest lift is below it, or level flight has another
    alpha.
    """
    air = air_at(table.values.get("altitude", 0.0), table.system)
    pressure = 0.5 * float(air.density) * of("speed") ** 2
    weight_coefficient = of("mass") * of("gravity") / (pressure * of("wing_area"))
    stated = of("CL_0")
    largest = table.values.get(LARGEST_LIFT) or max(stated, _LARGEST_LIFT)
    if stated > _RATIO * weight_coefficient:
        share, which = stated / weight_coefficient, "lift"
    elif largest < weight_coefficient:
        share, which = largest / weight_coefficient, f"largest lift (CL {largest:.3g})"
    else:
        yield from _of_alpha(of, weight_coefficient - stated)
        return
    yield (
        f"the {which} at {of('speed'):.4g} {table.unit('speed')} carries {share:.2g} times "
        "the weight; check the unit of the mass (1 slug = 32.17 lb)"
    )


def _of_alpha(of: _Values, missing: float) -> Iterator[str]:
    """Yield a sentence if level flight needs another alpha than the stated one.

    A table without alpha has no doubt, nor one whose slope of the lift is doubted.

    missing: lift coefficient that is missing to carry the weight at the stated alpha
    """
    stated, slope = of("alpha"), of("CL_alpha")
    change = missing / slope if slope else 0.0
    if math.isfinite(stated) and abs(change) > _OFF_ALPHA and not _doubt_of_slope("CL_alpha", of):
        yield (
            f"level flight at the condition of the derivatives is at alpha "
            f"{math.degrees(stated + change):.3g} deg, the table has {math.degrees(stated):.3g}"
            " deg; CL_0, CD_0 and Cm_0 are those at this alpha, not at alpha 0; check them, the "
            "mass, the speed and their units"
        )
