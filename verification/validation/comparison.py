"""The model beside what others have printed and released, with a limit on each difference, and what that says."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from hfa_model.aircraft import HFA, Aircraft
from hfa_model.vectors import INPUTS, LINEAR_STATES, Input
from hfa_support.reporting.checks import Check, Checked, at_most, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, shown_unit, shown_value
from trim.linear.compare import eigenvalue_errors
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import level_flight, release
from trim.point.solve import find_operating_point

SCHEMA = "hfa.validation/1"
#: Differences of a trim: unit, the largest that may be left, the unit in a sentence. Eigenvalues are printed to 1e-5.
_DIFFERENCES = {"deflection": ("rad", 5e-5, "rad"), "thrust": ("1", 3e-3, "of it"), "eigenvalue": ("1/s", 1e-4, "1/s")}
#: A cut digit is wrong by up to two half units, a rounded one by one.
MOST_HALF_UNITS = 2.0
#: The released simulation deflects its surfaces further than the trims of this project allow.
_ANY_INPUT = dict.fromkeys(INPUTS, (-10000.0, 10000.0))


class ReleasedTrim(NamedTuple):
    """One trim of the released simulation. speed: ft/s. dihedral, alpha: rad. inputs: lbf (throttle) and rad.

    eigenvalues: of its six-state A, one of each conjugate pair, 1/s, fastest first.
    """

    speed: float
    altitude: float
    dihedral: float
    alpha: float
    inputs: Input
    eigenvalues: tuple[complex, ...]


class PrintedEntry(NamedTuple):
    """One printed entry of A or B; `digits` as they stand on the page."""

    row: str
    column: str
    digits: str

    @property
    def name(self) -> str:
        """A(row, column) or B(row, column)."""
        return f"{'A' if self.column in LINEAR_STATES else 'B'}({self.row}, {self.column})"

    @property
    def half_unit(self) -> float:
        """Half of the last printed digit; 0 for an entry printed without decimals, which is exact."""
        decimals = len(self.digits.partition(".")[2])
        return 0.5 * 10.0**-decimals if decimals else 0.0


class TrimDifference(NamedTuple):
    """Ours minus theirs at one trim. deflection: largest of the four, rad. thrust: relative. eigenvalue: 1/s."""

    released: ReleasedTrim
    deflection: float
    thrust: float
    eigenvalue: float


class EntryDifference(NamedTuple):
    """A printed entry, ours, and the difference in half units of the last digit (0 where both are exact)."""

    printed: PrintedEntry
    computed: float
    half_units: float


@cache
def outside_data() -> dict[str, Any]:
    """The file, parsed."""
    return dict(json.loads(files("verification.validation").joinpath("outside.json").read_text(encoding="utf-8")))


def released_trims() -> tuple[ReleasedTrim, ...]:
    """The trims of the released simulation, in the order of the file."""
    data = outside_data()["released_simulation"]
    found = []
    for speed, degrees, alpha, *inputs, eigenvalues in data["rows"]:
        roots = tuple(complex(*parts) for parts in eigenvalues)
        found.append(ReleasedTrim(speed, data["altitude_ft"], math.radians(degrees), alpha, Input(*inputs), roots))
    return tuple(found)


def third_printed_model() -> tuple[PrintedEntry, ...]:
    """The entries of A and B of Qu 2018, Eq. (97), those of B under their inputs."""
    data = outside_data()["qu_2018"]
    return tuple(
        PrintedEntry(row, column, digits)
        for columns, rows in ((LINEAR_STATES, data["A"]), (data["B_inputs"], data["B"]))
        for row, digits_of_row in zip(LINEAR_STATES, rows, strict=True)
        for column, digits in zip(columns, digits_of_row, strict=True)
        if digits is not None
    )


@dataclass(frozen=True, repr=False)
class Validation(Checked, Reported):
    """Every comparison with the outside. fast_roots: (dihedral deg, read from the figure, computed), 1/s."""

    dynamics: str
    trims: tuple[TrimDifference, ...]
    entries: tuple[EntryDifference, ...]
    fast_roots: tuple[tuple[float, float, float], ...]
    checks: tuple[Check, ...]

    def report(self) -> Report:
        """The released simulation trim by trim, the third printed model entry by entry, and the verdicts."""
        sources = outside_data()
        trims = [
            (
                shown_value(theirs.speed, "ft/s"),
                f"{math.degrees(theirs.dihedral):g}",
                f"{math.degrees(theirs.alpha):.3f}",
                *(f"{each:.1e}" for each in off),
            )
            for theirs, *off in self.trims
        ]
        about = f"speed {shown_unit('ft/s')}", "dihedral deg", "alpha deg"
        entries = [
            (printed.name, printed.digits, f"{computed:.6f}", f"{off:+.2f}")
            for printed, computed, off in self.entries
            if printed.half_unit
        ]
        roots = [(f"{degrees:g}", f"{read:.2f}", f"{computed:.4f}") for degrees, read, computed in self.fast_roots]
        numbers = [
            (printed.name, float(printed.digits), computed, off, HFA.entry_unit(printed.row, printed.column))
            for printed, computed, off in self.entries
        ]
        units = {"speed": "ft/s", "dihedral": "rad", "alpha": "rad"}
        units |= {f"{name}_difference": unit for name, (unit, *_) in _DIFFERENCES.items()}
        return Report(
            title=f"Comparison with the outside, {self.dynamics} dynamics: {'PASS' if self.ok else 'FAIL'}",
            parts=(
                f"Trims and eigenvalues of the released simulation\n{sources['released_simulation']['source']}",
                Table((*about, "deflection, rad", "thrust, relative", "eigenvalue, 1/s"), trims),
                f"The third printed model, 10 deg at 30 ft/s\n{sources['qu_2018']['source']}",
                Table(("entry", "printed", "computed", "half units"), entries),
                f"Fast dihedral root at 30 ft/s\n{sources['gibson_2011']['source']}",
                Table(("dihedral deg", "read from the figure 1/s", "computed 1/s"), roots),
                checks_block(self.checks),
            ),
            data={
                "schema": SCHEMA,
                "dynamics": self.dynamics,
                "ok": self.ok,
                "checks": [check.to_dict() for check in self.checks],
                "trim_units": units,
                "trims": [
                    dict(zip(units, (theirs.speed, theirs.dihedral, theirs.alpha, *off), strict=True))
                    for theirs, *off in self.trims
                ],
                "entries": [
                    dict(zip(("entry", "printed", "computed", "half_units"), row[:4], strict=True)) for row in numbers
                ],
                "misprints": sources["qu_2018"]["misprints"],
            },
            records=Table(("entry", "printed", "computed", "half_units", "unit"), numbers),
        )


def validate(aircraft: Aircraft) -> Validation:
    """Trim at each of their conditions, linearize, compare."""
    models = {released: model_at(aircraft, released) for released in released_trims()}
    trims = tuple(_trim_difference(released, model) for released, model in models.items())
    known = outside_data()
    # Qu 2018 prints no true trim: ours is the released one at that speed and dihedral angle.
    qu, shown = known["qu_2018"], known["gibson_2011"]["fast_dihedral_root"]
    at = {(each.speed, each.dihedral): model for each, model in models.items()}
    third = at[qu["speed_ft_s"], math.radians(qu["dihedral_deg"])]
    entries = tuple(entry_difference(printed, third) for printed in third_printed_model())
    roots = []  # the fastest real root at the ends of Gibson's Fig. 7, at 30 ft/s
    for degrees, root in zip(shown["dihedral_deg"], shown["root_1_s"], strict=True):
        values = np.linalg.eigvals(at[30.0, math.radians(degrees)].A)
        roots.append((degrees, root, float(values[values.imag == 0.0].real.min())))
    return Validation(aircraft.variant.name, trims, entries, tuple(roots), _checks(trims, entries, roots))


def model_at(aircraft: Aircraft, released: ReleasedTrim) -> LinearModel:
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


def entry_difference(printed: PrintedEntry, model: LinearModel) -> EntryDifference:
    """An entry of the model beside its print."""
    matrix, columns = (model.A, model.states) if printed.column in model.states else (model.B, model.inputs)
    computed = float(matrix[model.states.index(printed.row), columns.index(printed.column)])
    difference = computed - float(printed.digits)
    if printed.half_unit:
        return EntryDifference(printed, computed, difference / printed.half_unit)
    return EntryDifference(printed, computed, 0.0 if abs(difference) <= 1e-12 else math.inf)


def _checks(
    trims: tuple[TrimDifference, ...],
    entries: tuple[EntryDifference, ...],
    roots: list[tuple[float, float, float]],
) -> tuple[Check, ...]:
    found = []
    for speed in dict.fromkeys(each.released.speed for each in trims):
        for what, (_, limit, unit) in _DIFFERENCES.items():
            these = [(abs(getattr(each, what)), each.released) for each in trims if each.released.speed == speed]
            value, worst = max(these, key=lambda each: each[0])
            reason = f"{what} off by {value:.2g} {unit} at {math.degrees(worst.dihedral):g} deg"
            found.append(at_most(f"{what}_{speed:g}_ft_s", value, limit, reason))
    off = max(entries, key=lambda each: abs(each.half_units))
    reason = f"{off.printed.name} is printed {off.printed.digits} and comes out {off.computed:.6g}"
    found.append(at_most("third_printed_model_half_units", abs(off.half_units), MOST_HALF_UNITS, reason))
    far = max(roots, key=lambda each: abs(each[2] - each[1]))
    read_to = outside_data()["gibson_2011"]["fast_dihedral_root"]["read_to"]
    reason = f"{far[2]:.3f} 1/s at {far[0]:g} deg where the figure shows {far[1]:g}"
    found.append(at_most("gibson_fig_7_fast_root", abs(far[2] - far[1]), read_to, reason))
    return tuple(found)
