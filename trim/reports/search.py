"""The equations of a trim, and what is unusual in the search for it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hfa_support.reporting.rows import Row
from hfa_support.reporting.text import Cell, Table, shown_value
from trim.point.diagnosis import MINOR, failure
from trim.point.operating_point import OperatingPoint
from trim.point.problem import STARTS, TrimProblem
from trim.point.status import BALANCE, Status
from trim.point.system import declared_start

#: Smaller scaled residuals are printed as this: they are about fifty roundings, and differ between
#: processors.
_NOISE = 1e-14


def equations_of(point: OperatingPoint) -> dict[str, dict[str, Any]]:
    """Return state or output -> data on its equation: the imposed value, the residual, its
    tolerance, the unit, and whether it balances.
    """
    condition = point.trim_problem.asked
    imposed = {**condition.imposed, **condition.rates}
    equations = {}
    for name, residual in point.residuals.items():
        tolerance = BALANCE * point.scale(name)
        equations[name] = {
            "imposed": imposed[name],
            "residual": residual,
            "tolerance": tolerance,
            "unit": point.equation_unit(name),
            "ok": abs(residual) <= tolerance,
        }
    return equations


def equations_table(point: OperatingPoint, equations: dict[str, dict[str, Any]]) -> Table:
    """Return a table of the equations, with those that do not balance first.

    The column of imposed rates is omitted if all imposed rates are 0.

    equations: data of `equations_of`
    """
    states = point.model.states
    with_rates = any(entry["imposed"] for name, entry in equations.items() if name in states)
    scaled = point.scaled_residuals
    rows = []
    for name, entry in sorted(equations.items(), key=lambda item: item[1]["ok"]):
        unit = entry["unit"]
        row = [f"rate of {name}" if name in states else name]
        if with_rates:
            rate = entry["imposed"] if name in states else 0.0
            row.append(f"{rate:.6g}")
        row.append(_size_text(entry["residual"], least=_NOISE * entry["tolerance"] / BALANCE))
        row.append(f"{entry['tolerance']:.2e}")
        row.append(unit)
        row.append(_size_text(scaled[name], least=_NOISE))
        row.append(Cell("PASS", "good") if entry["ok"] else Cell("FAIL", "bad"))
        rows.append(tuple(row))
    columns = ["equation", "residual", "tolerance", "unit", "scaled", "verdict"]
    if with_rates:
        columns.insert(1, "imposed")
    return Table(tuple(columns), rows)


def _size_text(value: float, least: float) -> str:
    """Return a residual as text, "0" or "<= 1e-14" if it is rounding."""
    if not value:
        return "0"
    return f"{value:.2e}" if abs(value) > least else f"<= {least:.0e}"


def balance_row(point: OperatingPoint) -> Row:
    """Return the row of the largest residual of the equations, relative to their scales."""
    count = len(point.residuals)
    wrong = sum(abs(each) > BALANCE for each in point.scaled_residuals.values())
    verdict, tone = f"all {count} equations balance", ""
    if wrong:
        verdict, tone = f"{wrong} of {count} equations do not balance", "bad"
    note = f"of its scale, tolerance {BALANCE:.0e}: {verdict}"
    return Row("largest residual", point.residual, note=note, least=_NOISE, tone=tone)


def other_trims(problem: TrimProblem, point: OperatingPoint) -> list[OperatingPoint]:
    """Return further trims of a problem with as many equations as unknowns.

    These are the trims that Newton's method finds from the declared initial values and from
    `STARTS` points within the limits, for example on the back side of the power curve. More trims
    may exist. The list is empty if the numbers of equations and unknowns differ.

    problem: the solved problem
    point: the trim
    """
    trim = problem.unknowns(point.values)
    equations, unknowns = problem.count
    starts = [*problem.starts(trim)]
    if not starts or equations != unknowns:
        return []
    starts.append(problem.unknowns(declared_start(problem.model, problem.asked.imposed)))
    trims = [trim]
    for z in problem.ends_within(starts):
        if problem.solved(z) and not any(_are_one_trim(problem, z, known) for known in trims):
            trims.append(z)
    return [OperatingPoint._of(problem, z, Status.TRIMMED) for z in trims[1:]]


def _are_one_trim(problem: TrimProblem, z: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two solutions, (k,), are one trim: the equations also balance between them."""
    return all(problem.balanced(z + share * (other - z)) for share in (0.25, 0.5, 0.75))


class Search(NamedTuple):
    """What a report says on the search for a trim.

    data: entries of the file
    sentences: sentences on unusual features
    unlimited: sentences on variables without limits
    """

    data: dict[str, Any]
    sentences: list[str]
    unlimited: list[str]


def search_of(point: OperatingPoint) -> Search:
    """Return data on the search for a trim, and sentences on unusual features of the search."""
    problem = point.trim_problem
    equations, unknowns = problem.count
    sentences = []
    others: list[OperatingPoint] = []
    if point.status == Status.TRIMMED:
        others = other_trims(problem, point)
        if unknowns > equations:
            sentences.append(
                f"Least effort: {unknowns} unknowns for {equations} equations, so this is the trim "
                "with the least Σ (input / scale)² near the initial point"
            )
    if point.initial_point:
        usual = failure(problem, problem.newton(problem.clip(problem.system.start)))
        sentences.append(f"From the default initial point: {usual}")
        sentences.append(
            f"Found from initial point {point.initial_point} of {STARTS} between the limits"
        )
    if problem.idle:
        idle = ", ".join(problem.idle)
        sentences.append(f"Neither held nor determined, kept at the start value: {idle}")
    sentences += [_other_trim(problem, point, other) for other in others]
    data = {
        "equations": equations,
        "unknowns": unknowns,
        "least_effort": unknowns > equations,
        "start": point.initial_point,
        "idle": list(problem.idle),
        "kept": list(problem.kept),
        "undetermined": point._undetermined.names,
        "other_trims": [{name: other.values[name] for name in problem.free} for other in others],
    }
    return Search(data, sentences, _unlimited(problem))


def _unlimited(problem: TrimProblem) -> list[str]:
    """Return a list with a sentence on the free variables without limits, if there are any."""
    limits = problem.system.limits
    is_unlimited = np.isinf(limits.lowest) & np.isinf(limits.highest)
    names = ", ".join(problem.free[i] for i in np.flatnonzero(is_unlimited))
    if not names:
        return []
    return [f"No limits are declared for {names}; check that the values are reachable"]


def _other_trim(problem: TrimProblem, point: OperatingPoint, other: OperatingPoint) -> str:
    """Return a sentence on another trim, with an initial point that leads to it."""
    model = problem.model
    differences = np.abs(problem.unknowns(other.values) - problem.unknowns(point.values))
    different = np.flatnonzero(differences > MINOR * differences.max())
    names = [problem.free[i] for i in different]
    values = ", ".join(f"{name} {model.describe(name, other.values[name])}" for name in names)
    # States decide which trim is found; the search chooses the inputs that balance them.
    begin = [name for name in names if name not in model.inputs] or names
    typed = ",".join(
        f"{name}={shown_value(other.values[name], model.unit(name))}" for name in begin
    )
    return f"Another trim exists: {values}; the initial point {typed} leads to it"
