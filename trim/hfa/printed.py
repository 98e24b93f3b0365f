"""Comparison of a linear model with the printed matrices, entry by entry, and error bands.

The error band of an entry follows from the rounding of the printed matrices, through the parameters
and the trim.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.layout import Layout
from hfa_aircraft.limits import SLACK
from hfa_aircraft.model import Model
from hfa_model.choice import aircraft
from hfa_model.parameters import (
    INPUTS,
    LINEAR_ROWS,
    LINEAR_STATES,
    STATES,
    Parameters,
    ParameterSet,
    default_parameters,
)
from hfa_model.published import PublishedModel, published_models
from hfa_model.variants import variant_named
from hfa_support.errors import BadInputError
from hfa_support.matrices import quadratic_forms
from hfa_support.native.bound import RowFunction
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import ByValue, Result
from hfa_support.reporting.text import Table, matrix_table
from hfa_support.units import si_factor
from trim.hfa.level_flight import level_flight
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint

#: Relative difference below which parameters count as the packaged ones: another seed or machine
#: changes them by less.
_PARAMETER_TOLERANCE = 1e-7


@dataclass(frozen=True)
class EntryRow(Result):
    """One entry of A or B, as computed from the aircraft and as printed in the paper.

    matrix: "A" or "B"
    row: name of a state
    column: name of a state or an input
    printed: value in the paper
    computed: value of the model
    half_unit: half a unit of the last printed digit
    """

    matrix: str
    row: str
    column: str
    printed: float
    computed: float
    half_unit: float

    @property
    def half_units(self) -> float:
        """Difference (computed - printed) in half units of the last printed digit.

        Within ±1, the computed value rounds to the printed value.
        """
        return (self.computed - self.printed) / self.half_unit

    @property
    def percent(self) -> float:
        """Difference (computed - printed) in percent of |printed|, or nan if printed is 0."""
        return (
            100 * (self.computed - self.printed) / abs(self.printed)
            if self.printed
            else float("nan")
        )

    @property
    def is_zero(self) -> bool:
        """True if the entry is printed as 0 and its computed magnitude is below 1e-6 half units,
        which only rounding is.
        """
        return self.printed == 0.0 and abs(self.half_units) < 1e-6

    @property
    def name(self) -> str:
        """Name of the entry, for example A(alpha, pitch_rate)."""
        return f"{self.matrix}({self.row}, {self.column})"

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "printed": self.printed,
            "computed": self.computed,
            "half_units": self.half_units,
            "percent": self.percent,
            "name": self.name,
        }


def compare(model: LinearModel, published: PublishedModel) -> tuple[EntryRow, ...]:
    """Return all 66 entries of A (6 x 6) and B (6 x 5) of a model, each with the printed value.

    The order is row by row, A before B.

    model: linear model of the paper's six states
    published: the printed pair (A, B)

    >>> import hfa
    >>> import hfa_model
    >>> import trim
    >>> printed = hfa_model.published_models()[0]
    >>> model = hfa.paper.level_model(hfa.aircraft(), printed.dihedral)
    >>> rows = trim.compare(model, printed)
    >>> round(max(abs(row.half_units) for row in rows), 2)
    1.21
    """
    parts = (
        ("A", LINEAR_STATES, model.A, published.A, published.half_unit_A),
        ("B", INPUTS, model.B, published.B, published.half_unit_B),
    )
    return tuple(
        EntryRow(
            matrix, row, column, float(printed[i, j]), float(computed[i, j]), float(half_unit[i, j])
        )
        for matrix, columns, computed, printed, half_unit in parts
        for i, row in enumerate(LINEAR_STATES)
        for j, column in enumerate(columns)
    )


def eigenvalue_errors(computed: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Return the distances |λ_computed - λ_reference| of paired eigenvalues, (n,), 1/s.

    The pairing of the two spectra has the smallest sum of distances. The result is in the order of
    `reference`.

    computed: (n,)
    reference: (n,)
    """
    from scipy.optimize import linear_sum_assignment

    distance = np.abs(reference[:, None] - computed[None, :])
    _, columns = linear_sum_assignment(distance)
    return distance[np.arange(len(reference)), columns]


def printed_at(point: OperatingPoint) -> PublishedModel | None:
    """Return the printed pair (A, B) for the flight condition of an operating point.

    The result is None if the paper prints no matrices for this condition.
    """
    for published in published_models():
        paper = level_flight(published.dihedral).imposed
        if all(
            abs(point.values[name] - value) <= SLACK * (1.0 + abs(value))
            for name, value in paper.items()
        ):
            return published
    return None


def comparison_table(model: LinearModel, published: PublishedModel) -> Table:
    """Return a table of a linear model's entries and the printed entries.

    published: the printed pair (A, B)
    """
    # The key "" puts nothing before the names of the entries.
    return entries_table(f"at {published.dihedral_deg:g} deg", {"": compare(model, published)})


def entries_table(title: str, entries: Mapping[str, Iterable[EntryRow]]) -> Table:
    """Return a table of printed and computed entries of A and B.

    Differences are in half units of the last printed digit, and in percent. Entries that are
    printed as 0 and are 0 are omitted.

    title: header of the first column
    entries: groups of entries; the key of a group is printed before the names of its entries
    """
    rows = []
    for before_name, group in entries.items():
        for entry in group:
            if entry.is_zero:
                continue
            printed = f"{entry.printed:.4f}"
            computed = f"{entry.computed:.6f}"
            half_units = f"{entry.half_units:+.2f}"
            percent = f"{entry.percent:+.4f}" if entry.printed else "-"
            rows.append((f"{before_name}{entry.name}", printed, computed, half_units, percent))
    return Table((title, "printed", "computed", "half units", "percent"), rows)


def entries_records(entries: Mapping[float, Iterable[EntryRow]]) -> Table:
    """Return a table of printed and computed entries of A and B in full precision, with units.

    entries: dihedral angle, deg, of a printed pair -> its entries
    """
    rows = []
    for angle, group in entries.items():
        for entry in group:
            unit = aircraft().entry_unit(entry.row, entry.column)
            numbers = (entry.printed, entry.computed, entry.half_units, entry.percent)
            rows.append((angle, entry.name, *numbers, unit))
    return Table(
        ("dihedral_deg", "entry", "printed", "computed", "half_units", "percent", "unit"), rows
    )


@dataclass(frozen=True, eq=False, repr=False)
class Bands(ByValue, Reported):
    """Half-widths of the error bands of a linear model's entries, in their units.

    Each half-width is two standard errors, propagated from the rounding of the printed matrices
    through the parameters and the trim. Errors of the equations are not included.

    A: (6, 6)
    B: (6, 5)
    """

    A: np.ndarray
    B: np.ndarray

    def report(self) -> Report:
        """Return a report with the half-width of the error band of every entry."""
        tables = [
            matrix_table(f"{name} ±", LINEAR_STATES, across, getattr(self, name))
            for name, across in (("A", LINEAR_STATES), ("B", INPUTS))
        ]
        return Report(
            "Two standard errors of each entry from the rounding of the printed matrices; rad,"
            " ft, s",
            tables,
        )


def has_bands(values: Parameters) -> bool:
    """Return whether parameters equal the identified ones to 1e-7; the covariance of others is
    unknown.
    """
    return np.allclose(values, default_parameters().values, rtol=_PARAMETER_TOLERANCE, atol=0.0)


def entry_bands(parameters: ParameterSet, condition: TrimCondition, model: LinearModel) -> Bands:
    """Return the error bands of the entries of a linear model with the paper's six states.

    The half-widths are two standard errors,
    2 sqrt(diag(J C J')),  J = ∂(A, B)/∂p + ∂(A, B)/∂v dv/dp,  dv/dp = -(∂f/∂v)⁻¹ ∂f/∂p.

    C is the covariance of the identified parameters p, and v are the free variables of the trim.
    dv/dp follows from the implicit function theorem.

    parameters: parameters of the model
    condition: trim condition of the model
    model: the linear model

    Raises BadInputError if no bands exist for the parameters (`has_bands`), or the states of the
    model are not the paper's six.

    >>> import hfa
    >>> from trim import entry_bands
    >>> model = hfa.paper.level_model(hfa.aircraft(), 0.2)
    >>> entry_bands(hfa.paper.default_parameters(), hfa.paper.level_flight(0.2), model).A.shape
    (6, 6)
    """
    if model.states != LINEAR_STATES:
        raise BadInputError(
            f"error bands exist only for the states {', '.join(LINEAR_STATES)}; select these states"
        )
    if not has_bands(parameters.values) or not parameters.covariance.size:
        raise BadInputError(
            "error bands exist only for the identified parameters with their covariance; "
            "use the parameters.toml of `python -m studies.identification`, unchanged"
        )
    native = model.model.native  # in the units of the parameters
    variant_named(native.name)  # refuses dynamics with more states
    variables = [model.point.values[name] for name in native.variables]
    v = model.model.native_values(native.variables, variables)
    free = [native.variables.index(name) for name in condition.free]
    balanced = [STATES.index(name) for name in STATES if name in condition.rates]
    p = np.array(parameters.values)
    entries = entries_at(native.layout, v, p, free, balanced)
    identified = [Parameters._fields.index(name) for name in parameters.identified]
    variances = quadratic_forms(entries.by_parameters[:, identified], parameters.covariance)
    half_widths = (2 * np.sqrt(variances)).reshape(len(LINEAR_STATES), -1, order="F")
    if model.model.source.native is not None:  # a model in SI units
        half_widths = _in_si(half_widths, native)
    return Bands(*np.split(half_widths, [len(LINEAR_STATES)], axis=1))


def _in_si(entries: np.ndarray, model: Model) -> np.ndarray:
    """Return entries of [A B] of the paper's signals, in the units of a model, in SI units."""
    rows, columns = (
        np.array([si_factor(model.unit(name)) for name in names])
        for names in (LINEAR_STATES, (*LINEAR_STATES, *INPUTS))
    )
    return entries * rows[:, None] / columns


class EntriesAlongTrim(NamedTuple):
    """Entries of A and B of the paper's six states, and their derivatives along the trim.

    entries: e = vec(A, B), (66,), in column-major order
    by_parameters: de/dp, (66, P), where the free variables follow the parameters so that the rates
        remain 0
    """

    entries: np.ndarray
    by_parameters: np.ndarray


def entries_at(
    layout: Layout, v: np.ndarray, p: np.ndarray, free: Sequence[int], balanced: Sequence[int]
) -> EntriesAlongTrim:
    """Return the entries of A and B at a trim, and their derivatives along the trim.

    layout: equations of the aircraft
    v: variables of the trim, (k,)
    p: parameters, (P,)
    free: indices of the free variables in v
    balanced: indices of the states whose rates remain 0
    """
    # Imposed values 0 enter the expressions as constants, which makes these shorter.
    zero = tuple(i for i in np.flatnonzero(v == 0.0).tolist() if i not in free)
    results = _derivatives(layout, tuple(free), zero)(v[None], p[None])
    entries, by_free, by_p, rates_by_free, rates_by_p = (result[0] for result in results)

    def matrix(derivatives: np.ndarray, columns: int) -> np.ndarray:
        """Return derivatives, stored column by column, as a matrix."""
        return derivatives.reshape(-1, columns, order="F")

    # More rates are balanced than variables are free, because pitch and dihedral angle are steady
    # without any equation: their rows are 0 in both matrices, which least squares permit.
    k, P = len(free), len(p)
    free_by_p = -np.linalg.lstsq(
        matrix(rates_by_free, k)[balanced], matrix(rates_by_p, P)[balanced]
    )[0]
    return EntriesAlongTrim(entries, matrix(by_p, P) + matrix(by_free, k) @ free_by_p)


@lru_cache(maxsize=16)
def _derivatives(layout: Layout, free: tuple[int, ...], zero: tuple[int, ...]) -> RowFunction:
    """Return the Function (v, p) -> e = vec(A, B) of the six states, ∂e/∂v, ∂e/∂p, ∂f/∂v, ∂f/∂p.

    v are the variables of a trim, from which states and inputs follow, f are the rates of all
    states, and ∂v is by the free variables alone.

    free: indices in v of the free variables
    zero: indices in v of imposed variables that are 0, constants here, for shorter expressions
    """
    x, u, p = layout.symbols("x", "u", "p")
    f, _ = layout.expressions((x, u, p), ())
    A = ca.densify(ca.jacobian(f, x)[LINEAR_ROWS, LINEAR_ROWS])
    B = ca.densify(ca.jacobian(f, u)[LINEAR_ROWS, :])
    entries = ca.vertcat(ca.vec(A), ca.vec(B))

    # The same as functions of v and p.
    v = ca.SX.sym("v", len(layout.variables))
    values = {name: ca.SX(0) if i in zero else v[i] for i, name in enumerate(layout.variables)}
    trim_x, trim_u, *_ = layout.in_variables(values, p, ())
    entries, f = ca.substitute([entries, f], [x, u], [trim_x, trim_u])

    moving = ca.vertcat(*(v[i] for i in free))
    results = [
        entries,
        ca.jacobian(entries, moving),
        ca.jacobian(entries, p),
        ca.jacobian(f, moving),
        ca.jacobian(f, p),
    ]
    dense = [ca.densify(result) for result in results]
    return RowFunction(ca.Function("entry_derivatives", [v, p], dense))
