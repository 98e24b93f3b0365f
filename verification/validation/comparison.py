"""The model beside what others have printed and released, with a limit on each difference."""

from __future__ import annotations

import math

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.reporting.checks import Check, at_most
from hfa_model.vectors import INPUTS
from trim.linear.compare import eigenvalue_errors
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import level_flight, release
from trim.point.solve import find_operating_point
from verification.validation.outside import (
    PrintedEntry,
    ReleasedTrim,
    outside_data,
    released_trims,
    third_printed_model,
    trim_of_third_printed_model,
)
from verification.validation.validation_result import EntryDifference, TrimDifference, Validation

#: Largest differences that may be left. Deflections: rad. Thrust: relative. Eigenvalues: 1/s, printed to 1e-5.
MOST_DEFLECTION, MOST_THRUST, MOST_EIGENVALUE = 5e-5, 3e-3, 1e-4
#: A cut digit is wrong by up to two half units, a rounded one by one.
MOST_HALF_UNITS = 2.0
#: The released simulation deflects its surfaces further than the trims of this project allow.
_ANY_INPUT = dict.fromkeys(INPUTS, (-10000.0, 10000.0))


def validate(aircraft: Aircraft) -> Validation:
    """Trim at each of their conditions, linearize, compare."""
    models = {released: _model_at(aircraft, released) for released in released_trims()}
    trims = tuple(_trim_difference(released, model) for released, model in models.items())
    at_third = models[trim_of_third_printed_model()]
    entries = tuple(_entry_difference(printed, at_third) for printed in third_printed_model())
    roots = _fast_roots(models)
    return Validation(aircraft.variant.name, trims, entries, roots, _checks(trims, entries, roots))


def _model_at(aircraft: Aircraft, released: ReleasedTrim) -> LinearModel:
    """Five inputs balance four equations: alpha and the center aileron are held at theirs, the rest is solved."""
    level = level_flight(
        released.dihedral, speed=released.speed, altitude=released.altitude, alpha=released.alpha, limits=_ANY_INPUT
    )
    condition = release(level, hold={"aileron_center": released.inputs.aileron_center})
    return linearize(aircraft, find_operating_point(aircraft, condition))


def _trim_difference(released: ReleasedTrim, model: LinearModel) -> TrimDifference:
    off = np.abs(np.array(model.point.inputs) - np.array(released.inputs))
    paired = [value for root in released.eigenvalues for value in {root, root.conjugate()}]
    errors = np.abs(eigenvalue_errors(np.linalg.eigvals(model.A), np.array(paired)))
    return TrimDifference(released, float(off[1:].max()), float(off[0] / released.inputs.throttle), float(errors.max()))


def _entry_difference(printed: PrintedEntry, model: LinearModel) -> EntryDifference:
    matrix, columns = (model.A, model.states) if printed.column in model.states else (model.B, model.inputs)
    computed = float(matrix[model.states.index(printed.row), columns.index(printed.column)])
    difference = computed - printed.value
    if printed.half_unit:
        return EntryDifference(printed, computed, difference / printed.half_unit)
    return EntryDifference(printed, computed, 0.0 if abs(difference) <= 1e-12 else math.inf)


def _fast_roots(models: dict[ReleasedTrim, LinearModel]) -> tuple[tuple[float, float, float], ...]:
    """The fastest real root at the ends of Gibson's Fig. 7, at 30 ft/s."""
    shown = outside_data()["gibson_2011"]["fast_dihedral_root"]
    found = []
    for degrees, root in zip(shown["dihedral_deg"], shown["root_1_s"], strict=True):
        model = next(m for r, m in models.items() if r.speed == 30.0 and abs(math.degrees(r.dihedral) - degrees) < 1e-9)
        real = [value.real for value in np.linalg.eigvals(model.A) if value.imag == 0.0]
        found.append((degrees, root, float(min(real))))
    return tuple(found)


def _checks(
    trims: tuple[TrimDifference, ...],
    entries: tuple[EntryDifference, ...],
    roots: tuple[tuple[float, float, float], ...],
) -> tuple[Check, ...]:
    found = []
    for speed in dict.fromkeys(each.released.speed for each in trims):
        these = [each for each in trims if each.released.speed == speed]
        for what, limit, unit in (
            ("deflection", MOST_DEFLECTION, " rad"),
            ("thrust", MOST_THRUST, " of it"),
            ("eigenvalue", MOST_EIGENVALUE, " 1/s"),
        ):
            worst = max(these, key=lambda each, what=what: abs(getattr(each, what)))  # type: ignore[misc]
            value = abs(getattr(worst, what))
            reason = f"{what} off by {value:.2g}{unit} at {math.degrees(worst.released.dihedral):g} deg"
            found.append(at_most(f"{what}_{speed:g}_ft_s", value, limit, reason))
    off = max(entries, key=lambda each: abs(each.half_units))
    reason = f"{off.printed.name} is printed {off.printed.digits} and comes out {off.computed:.6g}"
    found.append(at_most("third_printed_model_half_units", abs(off.half_units), MOST_HALF_UNITS, reason))
    read_to = outside_data()["gibson_2011"]["fast_dihedral_root"]["read_to"]
    far = max(roots, key=lambda each: abs(each[2] - each[1]))
    reason = f"{far[2]:.3f} 1/s at {far[0]:g} deg where the figure shows {far[1]:g}"
    found.append(at_most("gibson_fig_7_fast_root", abs(far[2] - far[1]), read_to, reason))
    return tuple(found)
