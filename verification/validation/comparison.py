"""The model beside what others have printed and released, with a limit on each difference, and what that says."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, LINEAR_STATES, Input, entry_unit
from hfa_support.reporting.checks import Check, Checked, at_most, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, shown_unit, shown_value
from trim.linear.compare import eigenvalue_errors
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import level_flight, release
from trim.point.solve import find_operating_point


@dataclass(frozen=True)
class ReleasedTrim:
    """One trim of the released simulation. speed: ft/s. dihedral, alpha: rad. inputs: lbf (throttle) and rad.

    eigenvalues: of its six-state A, one of each conjugate pair, 1/s, fastest first.
    """

    speed: float
    altitude: float
    dihedral: float
    alpha: float
    inputs: Input
    eigenvalues: tuple[complex, ...]


@dataclass(frozen=True)
class PrintedEntry:
    """One printed entry of A or B; `digits` as they stand on the page."""

    name: str
    row: str
    column: str
    digits: str

    @property
    def value(self) -> float:
        """The printed number."""
        return float(self.digits)

    @property
    def unit(self) -> str:
        """Of the number."""
        return entry_unit(self.row, self.column)

    @property
    def half_unit(self) -> float:
        """Half of the last printed digit; 0 for an entry printed without decimals, which is exact."""
        decimals = len(self.digits.partition(".")[2])
        return 0.5 * 10.0**-decimals if decimals else 0.0


@cache
def outside_data() -> dict[str, Any]:
    """The file, parsed."""
    return dict(json.loads(files("verification.validation").joinpath("outside.json").read_text(encoding="utf-8")))


def released_trims() -> tuple[ReleasedTrim, ...]:
    """The trims of the released simulation, in the order of the file."""
    data = outside_data()["released_simulation"]
    return tuple(
        ReleasedTrim(
            speed=speed,
            altitude=data["altitude_ft"],
            dihedral=math.radians(degrees),
            alpha=alpha,
            inputs=Input(*inputs),
            eigenvalues=tuple(complex(*parts) for parts in eigenvalues),
        )
        for speed, degrees, alpha, *inputs, eigenvalues in data["rows"]
    )


def third_printed_model() -> tuple[PrintedEntry, ...]:
    """The entries of A and B of Qu 2018, Eq. (97), those of B under their inputs."""
    data = outside_data()["qu_2018"]
    found = []
    for name, columns, rows in (("A", LINEAR_STATES, data["A"]), ("B", data["B_inputs"], data["B"])):
        for row, digits_of_row in zip(LINEAR_STATES, rows, strict=True):
            for column, digits in zip(columns, digits_of_row, strict=True):
                assert column in INPUTS or column in LINEAR_STATES
                if digits is not None:
                    found.append(PrintedEntry(f"{name}({row}, {column})", row, column, digits))
    return tuple(found)


def trim_of_third_printed_model() -> ReleasedTrim:
    """The released trim at the speed and dihedral angle of Qu 2018, Eq. (97), which prints no true trim."""
    data = outside_data()["qu_2018"]
    dihedral = math.radians(data["dihedral_deg"])
    return next(each for each in released_trims() if (each.speed, each.dihedral) == (data["speed_ft_s"], dihedral))


SCHEMA = "hfa.validation/1"
#: Differences of a trim: unit, the largest that may be left, the unit in a sentence. Eigenvalues are printed to 1e-5.
_DIFFERENCES = {"deflection": ("rad", 5e-5, "rad"), "thrust": ("1", 3e-3, "of it"), "eigenvalue": ("1/s", 1e-4, "1/s")}
#: A cut digit is wrong by up to two half units, a rounded one by one.
MOST_HALF_UNITS = 2.0
#: The released simulation deflects its surfaces further than the trims of this project allow.
_ANY_INPUT = dict.fromkeys(INPUTS, (-10000.0, 10000.0))


@dataclass(frozen=True)
class TrimDifference:
    """Ours minus theirs at one trim. deflection: largest of the four, rad. thrust: relative. eigenvalue: 1/s."""

    released: ReleasedTrim
    deflection: float
    thrust: float
    eigenvalue: float


@dataclass(frozen=True)
class EntryDifference:
    """A printed entry, ours, and the difference in half units of the last digit (0 where both are exact)."""

    printed: PrintedEntry
    computed: float
    half_units: float


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
        return Report(
            title=f"Comparison with the outside, {self.dynamics} dynamics: {'PASS' if self.ok else 'FAIL'}",
            parts=(
                f"Trims and eigenvalues of the released simulation\n{sources['released_simulation']['source']}",
                _trims(self),
                f"The third printed model, 10 deg at 30 ft/s\n{sources['qu_2018']['source']}",
                _entries(self),
                f"Fast dihedral root at 30 ft/s\n{sources['gibson_2011']['source']}",
                Table(
                    ("dihedral deg", "read from the figure 1/s", "computed 1/s"),
                    [(f"{degrees:g}", f"{read:.2f}", f"{computed:.4f}") for degrees, read, computed in self.fast_roots],
                ),
                checks_block(self.checks),
            ),
            data=_data(self),
            records=Table(
                ("entry", "printed", "computed", "half_units", "unit"),
                [
                    (each.printed.name, each.printed.value, each.computed, each.half_units, each.printed.unit)
                    for each in self.entries
                ],
            ),
        )


def _trims(found: Validation) -> Table:
    rows = [
        (
            shown_value(each.released.speed, "ft/s"),
            f"{math.degrees(each.released.dihedral):g}",
            f"{math.degrees(each.released.alpha):.3f}",
            *(f"{getattr(each, name):.1e}" for name in _DIFFERENCES),
        )
        for each in found.trims
    ]
    differences = ("deflection, rad", "thrust, relative", "eigenvalue, 1/s")
    return Table((f"speed {shown_unit('ft/s')}", "dihedral deg", "alpha deg", *differences), rows)


def _entries(found: Validation) -> Table:
    rows = [
        (each.printed.name, each.printed.digits, f"{each.computed:.6f}", f"{each.half_units:+.2f}")
        for each in found.entries
        if each.printed.half_unit
    ]
    return Table(("entry", "printed", "computed", "half units"), rows)


def _data(found: Validation) -> dict[str, Any]:
    condition = {"speed": "ft/s", "dihedral": "rad", "alpha": "rad"}
    differences = {f"{name}_difference": name for name in _DIFFERENCES}
    return {
        "schema": SCHEMA,
        "dynamics": found.dynamics,
        "ok": found.ok,
        "checks": [check.to_dict() for check in found.checks],
        "trim_units": condition | {key: _DIFFERENCES[name][0] for key, name in differences.items()},
        "trims": [
            {name: getattr(each.released, name) for name in condition}
            | {key: getattr(each, name) for key, name in differences.items()}
            for each in found.trims
        ],
        "entries": [
            {"entry": each.printed.name, "printed": each.printed.value, "computed": each.computed}
            | {"half_units": each.half_units}
            for each in found.entries
        ],
        "misprints": outside_data()["qu_2018"]["misprints"],
    }


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
        for what, (_, limit, unit) in _DIFFERENCES.items():
            worst = max(these, key=lambda each, what=what: abs(getattr(each, what)))  # type: ignore[misc]
            value = abs(getattr(worst, what))
            reason = f"{what} off by {value:.2g} {unit} at {math.degrees(worst.released.dihedral):g} deg"
            found.append(at_most(f"{what}_{speed:g}_ft_s", value, limit, reason))
    off = max(entries, key=lambda each: abs(each.half_units))
    reason = f"{off.printed.name} is printed {off.printed.digits} and comes out {off.computed:.6g}"
    found.append(at_most("third_printed_model_half_units", abs(off.half_units), MOST_HALF_UNITS, reason))
    read_to = outside_data()["gibson_2011"]["fast_dihedral_root"]["read_to"]
    far = max(roots, key=lambda each: abs(each[2] - each[1]))
    reason = f"{far[2]:.3f} 1/s at {far[0]:g} deg where the figure shows {far[1]:g}"
    found.append(at_most("gibson_fig_7_fast_root", abs(far[2] - far[1]), read_to, reason))
    return tuple(found)
