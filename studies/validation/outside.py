"""Comparison of the model with published and released data, with a limit for each difference."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import hfa_model
from hfa_aircraft.model import Model
from hfa_model.parameters import INPUTS, LINEAR_STATES, Input
from hfa_support.reporting.report import Check, Checked, Report, Reported, at_most, checks_block
from hfa_support.reporting.text import Table, shown_unit, shown_value
from trim.hfa.level_flight import level_flight
from trim.hfa.printed import EntryRow, eigenvalue_errors, entries_records, entries_table
from trim.linear.linear_model import LinearModel
from trim.linear.linearize import linearize
from trim.point.condition import release
from trim.point.solve import trim

SCHEMA = "hfa.validation/1"
#: Difference of a trim -> (limit, unit in messages). Eigenvalues are printed to 1e-5.
_DIFFERENCES = {"deflection": (5e-5, "rad"), "thrust": (3e-3, "of it"), "eigenvalue": (1e-4, "1/s")}
#: The error of a truncated number is up to two half units, and of a rounded number one.
MOST_HALF_UNITS = 2.0
#: Tolerance of an entry that is an exact integer.
ROUNDING = 5e-13
#: Limits that include all surface deflections of the released simulation.
_ANY_INPUT = dict.fromkeys(INPUTS, (-10000.0, 10000.0))


class ReleasedTrim(NamedTuple):
    """One trim of the released simulation.

    speed: ft/s
    altitude: ft
    dihedral, alpha: rad
    inputs: throttle in lbf, surfaces in rad
    eigenvalues: of the released A with six states, one of each conjugate pair, 1/s, fastest first
    """

    speed: float
    altitude: float
    dihedral: float
    alpha: float
    inputs: Input
    eigenvalues: tuple[complex, ...]


class TrimDifference(NamedTuple):
    """Differences between the model's trim and one released trim.

    speed: speed of the trim, ft/s
    dihedral, alpha: dihedral angle and angle of attack of the released trim, rad
    deflection_difference: largest difference of a deflection, rad
    thrust_difference: relative difference of the thrust
    eigenvalue_difference: largest difference of an eigenvalue, 1/s
    """

    speed: float
    dihedral: float
    alpha: float
    deflection_difference: float
    thrust_difference: float
    eigenvalue_difference: float


class FastRoot(NamedTuple):
    """Fastest real root at a dihedral angle, deg: read from a figure, and computed, 1/s."""

    dihedral_deg: float
    read: float
    computed: float


_UNITS = dict(zip(TrimDifference._fields, ("ft/s", "rad", "rad", "rad", "1", "1/s"), strict=True))


@cache
def outside_data() -> dict[str, Any]:
    """Return the content of outside.json."""
    return dict(json.loads(Path(__file__).with_name("outside.json").read_text("utf-8")))


def released_trims() -> tuple[ReleasedTrim, ...]:
    """Return the trims of the released simulation, in the order of outside.json."""
    data = outside_data()["released_simulation"]
    trims = []
    for speed, degrees, alpha, *inputs, eigenvalues in data["rows"]:
        trims.append(
            ReleasedTrim(
                speed,
                data["altitude_ft"],
                math.radians(degrees),
                alpha,
                Input(*inputs),
                tuple(complex(*parts) for parts in eigenvalues),
            )
        )
    return tuple(trims)


def third_printed_entries(model: LinearModel) -> tuple[EntryRow, ...]:
    """Return the entries of A and B printed in Qu 2018, Eq. (97), each with that of a linear model.

    The printed B contains two of the inputs.
    """
    data = outside_data()["qu_2018"]
    entries = []
    for name, computed, columns, printed_columns in (
        ("A", model.A, LINEAR_STATES, LINEAR_STATES),
        ("B", model.B, INPUTS, data["B_inputs"]),
    ):
        for i, row in enumerate(LINEAR_STATES):
            for column, digits in zip(printed_columns, data[name][i], strict=True):
                if digits is None:  # not printed for this input
                    continue
                value = float(computed[i, columns.index(column)])
                entries.append(
                    EntryRow(name, row, column, float(digits), value, _half_unit(digits))
                )
    return tuple(entries)


def _half_unit(digits: str) -> float:
    """Return half a unit of the last decimal of a printed number."""
    decimals = len(digits.partition(".")[2])
    return 0.5 * 10.0**-decimals if decimals else ROUNDING


@dataclass(frozen=True, repr=False)
class Validation(Checked, Reported):
    """All comparisons with published and released data.

    dynamics: name of the dynamics
    trims: differences at the trims of the released simulation
    entries: entries of the third printed model
    fast_roots: roots at the ends of Gibson's Fig. 7
    checks: limits on all differences
    """

    dynamics: str
    trims: tuple[TrimDifference, ...]
    entries: tuple[EntryRow, ...]
    fast_roots: tuple[FastRoot, ...]
    checks: tuple[Check, ...]

    def report(self) -> Report:
        """Return a report of released trims, the third printed model, fast roots and checks."""
        sources = outside_data()
        trims = [
            (
                shown_value(speed, "ft/s"),
                f"{math.degrees(dihedral):g}",
                f"{math.degrees(alpha):.3f}",
                *(f"{difference:.1e}" for difference in differences),
            )
            for speed, dihedral, alpha, *differences in self.trims
        ]
        inexact = [entry for entry in self.entries if entry.half_unit > ROUNDING]
        about = f"speed {shown_unit('ft/s')}", "dihedral deg", "alpha deg"
        roots = [
            (f"{degrees:g}", f"{read:.2f}", f"{computed:.4f}")
            for degrees, read, computed in self.fast_roots
        ]
        return Report(
            title=(
                f"Comparison with external data, {self.dynamics} dynamics:"
                f" {'PASS' if self.ok else 'FAIL'}"
            ),
            parts=(
                (
                    "Trims and eigenvalues of the released"
                    f" simulation\n{sources['released_simulation']['source']}"
                ),
                Table((*about, "deflection, rad", "thrust, relative", "eigenvalue, 1/s"), trims),
                f"The third printed model, 10 deg at 30 ft/s\n{sources['qu_2018']['source']}",
                entries_table("entry", {"": inexact}),
                f"Fast dihedral root at 30 ft/s\n{sources['gibson_2011']['source']}",
                Table(("dihedral deg", "read from the figure 1/s", "computed 1/s"), roots),
                checks_block(self.checks),
            ),
            data={
                "schema": SCHEMA,
                "dynamics": self.dynamics,
                "ok": self.ok,
                "checks": [check.to_dict() for check in self.checks],
                "trim_units": _UNITS,
                "trims": [row._asdict() for row in self.trims],
                "entries": [entry.to_dict() for entry in self.entries],
                "misprints": sources["qu_2018"]["misprints"],
            },
            records=entries_records({sources["qu_2018"]["dihedral_deg"]: self.entries}),
        )


def validate(aircraft: Model) -> Validation:
    """Return the comparison of the model with all published and released data."""
    models = {released: model_at(aircraft, released) for released in released_trims()}
    trims = tuple(_trim_difference(released, model) for released, model in models.items())
    known = outside_data()
    # Qu 2018 prints no trim. The released trim at that speed and dihedral angle is used.
    qu = known["qu_2018"]
    figure = known["gibson_2011"]["fast_dihedral_root"]
    model_at_trim = {(each.speed, each.dihedral): model for each, model in models.items()}
    third_model = model_at_trim[qu["speed_ft_s"], math.radians(qu["dihedral_deg"])]
    entries = third_printed_entries(third_model)
    roots = []
    for degrees, root in zip(figure["dihedral_deg"], figure["root_1_s"], strict=True):
        eigenvalues = np.linalg.eigvals(model_at_trim[30.0, math.radians(degrees)].A)
        fastest = float(eigenvalues[eigenvalues.imag == 0.0].real.min())
        roots.append(FastRoot(degrees, root, fastest))
    return Validation(
        hfa_model.variant_of(aircraft).name,
        trims,
        entries,
        tuple(roots),
        _checks(trims, entries, roots),
    )


def model_at(aircraft: Model, released: ReleasedTrim) -> LinearModel:
    """Return the linear model at a released trim.

    Alpha is held at the released value. Five inputs then balance four equations. Therefore the
    center aileron is held at the released value too, and the other inputs are solved for.
    """
    level = level_flight(
        released.dihedral,
        speed=released.speed,
        altitude=released.altitude,
        alpha=released.alpha,
        limits=_ANY_INPUT,
    )
    condition = release(level, hold={"aileron_center": released.inputs.aileron_center})
    return linearize(aircraft, trim(aircraft, condition))


def _trim_difference(released: ReleasedTrim, model: LinearModel) -> TrimDifference:
    """Return the differences between a released trim and that of a linear model."""
    thrust, *deflections = np.abs(np.array(model.point.inputs) - np.array(released.inputs)).tolist()
    # A set, so that a real eigenvalue, which equals its conjugate, counts once.
    eigenvalues = [value for root in released.eigenvalues for value in {root, root.conjugate()}]
    errors = eigenvalue_errors(np.linalg.eigvals(model.A), np.array(eigenvalues))
    return TrimDifference(
        released.speed,
        released.dihedral,
        released.alpha,
        deflection_difference=max(deflections),
        thrust_difference=thrust / released.inputs.throttle,
        eigenvalue_difference=float(errors.max()),
    )


def _checks(
    trims: tuple[TrimDifference, ...],
    entries: tuple[EntryRow, ...],
    roots: list[FastRoot],
) -> tuple[Check, ...]:
    """Return the limits on the largest differences of trims, entries and roots."""
    checks = []
    for speed in dict.fromkeys(each.speed for each in trims):
        for what, (limit, unit) in _DIFFERENCES.items():
            differences = [
                (getattr(each, f"{what}_difference"), each.dihedral)
                for each in trims
                if each.speed == speed
            ]
            largest, dihedral = max(differences)
            reason = f"{what} off by {largest:.2g} {unit} at {math.degrees(dihedral):g} deg"
            checks.append(at_most(f"{what}_{speed:g}_ft_s", largest, limit, reason))
    entry = max(entries, key=lambda each: abs(each.half_units))
    reason = f"{entry.name} is printed {entry.printed:g} and comes out {entry.computed:.6g}"
    checks.append(
        at_most("third_printed_model_half_units", abs(entry.half_units), MOST_HALF_UNITS, reason)
    )
    root = max(roots, key=lambda each: abs(each.computed - each.read))
    read_to = outside_data()["gibson_2011"]["fast_dihedral_root"]["read_to"]
    reason = (
        f"{root.computed:.3f} 1/s at {root.dihedral_deg:g} deg where the figure shows {root.read:g}"
    )
    difference = abs(root.computed - root.read)
    checks.append(at_most("gibson_fig_7_fast_root", difference, read_to, reason))
    return tuple(checks)
