"""Report of the value of a nonlinear game about a trim."""

from __future__ import annotations

import math

from controller.expansion.expansion import PERMITTED_ERROR, Expansion
from controller.expansion.radius import Radius
from controller.expansion.series import name_of
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import storable
from hfa_support.reporting.text import Table, shown_unit, shown_value


def expansion_report(expansion: Expansion) -> Report:
    """Return a report of the degree and the radii of V2 and of V."""
    names = expansion.game.names
    radii = expansion.radii
    columns = [name_of_value(radius.degree) for radius in radii]
    rows = [("z'Pz", "", *(_size_of_set(radius) for radius in radii))]
    units = names.state_units
    for index, (state, unit) in enumerate(zip(names.states, units, strict=True)):
        extents = [shown_value(float(each.extents[index]), unit, ".3g") for each in radii]
        rows.append((state, shown_unit(unit), *extents))
    weights = zip(expansion.basis.exponents.tolist(), expansion.weights.tolist(), strict=True)
    return Report(
        title=(
            f"Nonlinear game: {name_of_value(expansion.order)} has {expansion.basis.size}"
            f" coefficients, proved within {expansion.error:.1g}"
        ),
        parts=(
            "Sampled flights of both players, without input limits, cost what V predicts\n"
            f"within {100 * PERMITTED_ERROR:g} % in the set z'Pz <= c, of these largest"
            " deviations:",
            Table(("largest", "unit", *columns), rows),
        ),
        data=storable(expansion),
        records=Table(
            ("monomial", "weight"),
            [(name_of(powers, names.states), weight) for powers, weight in weights],
        ),
    )


def name_of_value(degree: int) -> str:
    """Return "V2", "V2 + V3" or "V2 + ... + V4"."""
    between = " + ..." if degree > 3 else ""
    return "V2" if degree == 2 else f"V2{between} + V{degree}"


def _size_of_set(radius: Radius) -> str:
    """Return c of the set z'Pz <= c as text, "unlimited", or "none"."""
    if math.isinf(radius.c):
        return "unlimited"
    return f"{radius.c:.3g}" if radius.c else "none"
