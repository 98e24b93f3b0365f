"""How uncertain each entry of A and B is: the rounding of the print, propagated through the parameters and the trim."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from hfa_model.aircraft import HFA, Equations
from hfa_model.parameters import Parameters, ParameterSet, default_parameters
from hfa_model.variants import Variant, variant_named
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_ROWS, LINEAR_STATES, LINEAR_UNITS, STATES
from hfa_support.errors import BadInputError
from hfa_support.model import Layout, components
from hfa_support.reporting.fields import ByValue
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import matrix_table
from hfa_support.reporting.unit_system import entries_in_force
from trim.linear.linear_model import LinearModel
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint

#: Parameters identified with another seed, or on another machine, differ by less than this from the packaged ones.
_SAME = 1e-7


#: Why a model comes without bands.
NO_BANDS = (
    "No bands of the rounding of the print: they are known for the six printed states of the identified aircraft only"
)


@dataclass(frozen=True, eq=False, repr=False)
class Bands(ByValue, Reported):
    """Half widths of the bands of a linear model's entries, A (6, 6) and B (6, 5), in their units: two standard errors,
    propagated from the rounding of the print through the parameters and the trim. The equations are taken as they are:
    `docs/validation.md` says where they were tested.
    """

    A: np.ndarray
    B: np.ndarray

    def report(self) -> Report:
        """The half width of every entry."""
        tables = [
            matrix_table(f"{name} ±", LINEAR_STATES, across, getattr(self, name))
            for name, across in (("A", LINEAR_STATES), ("B", INPUTS))
        ]
        return Report("Two standard errors of each entry from the rounding of the printed matrices; rad, ft, s", tables)


def trust_in(bands: Bands | None, model: LinearModel | None = None, other: LinearModel | None = None) -> str:
    """How far the entries of a six-state model may be off: by the rounding of the print, and by the choice of the
    dynamics, `other` being the model of the other ones at the same condition."""
    said = NO_BANDS
    if bands is not None:
        said = f"Largest band of an entry from the rounding of the print: {_largest(bands.A, bands.B)}"
    if model is not None and other is not None:
        difference = _largest(np.abs(other.A - model.A), np.abs(other.B - model.B))
        said += f"\nLargest difference of an entry to {other.point.dynamics} dynamics: {difference}"
    return f"{said} (every entry: --json or -o)" if said != NO_BANDS else said


def _largest(A: np.ndarray, B: np.ndarray) -> str:
    """The largest entry of both, in the units in force, and which it is."""
    A = entries_in_force(A, (LINEAR_UNITS, 1), (LINEAR_UNITS, -1))
    B = entries_in_force(B, (LINEAR_UNITS, 1), (tuple(INPUT_UNITS), -1))
    name, columns, largest = ("A", LINEAR_STATES, A) if A.max() >= B.max() else ("B", INPUTS, B)
    row, column = np.unravel_index(largest.argmax(), largest.shape)
    return f"{largest[row, column]:.2g} in {name}({LINEAR_STATES[row]}, {columns[column]})"


def bands_known(parameters: ParameterSet) -> bool:
    """Whether these parameters have bands: the identified values (to 1e-7), with their covariance.

    The covariance is that of the parameters that the print gives. Beside an edited value it is the uncertainty of
    another aircraft.
    """
    same = np.allclose(parameters.values, default_parameters().values, rtol=_SAME, atol=0.0)
    return same and parameters.covariance.size > 0


def entry_bands(parameters: ParameterSet, condition: TrimCondition, model: LinearModel) -> Bands:
    """Bands of the entries of a six-state linear model, made with these parameters at a trim of this condition.

    2 sqrt(diag(J C J')), J = ∂(A, B)/∂p + ∂(A, B)/∂v dv/dp, dv/dp = -(∂f/∂v)⁻¹ ∂f/∂p (implicit function
    theorem), C the covariance of the identified parameters p, v the free variables of the trim.
    BadInputError when the parameters have no bands (`bands_known`), or the model is not of the paper's six states.
    """
    if model.states != LINEAR_STATES:
        raise BadInputError(f"bands are known for the states {', '.join(LINEAR_STATES)} only; select them")
    if not bands_known(parameters):
        raise BadInputError(
            "bands are known for the identified parameters with their covariance only; "
            "use the parameters.toml of `hfa identify`, unchanged"
        )
    variant = variant_named(model.point.dynamics)
    jacobian = _total_derivative(parameters, variant, condition, model.point)
    n, m = len(LINEAR_STATES), len(INPUTS)
    both = 2 * np.sqrt(np.einsum("ij,jk,ik->i", jacobian, parameters.covariance, jacobian))
    # CasADi stacks columns.
    return Bands(*np.split(both.reshape(n, n + m, order="F"), [n], axis=1))


def _total_derivative(
    parameters: ParameterSet, variant: Variant, condition: TrimCondition, point: OperatingPoint
) -> np.ndarray:
    """d vec(A, B) / d(identified parameters) along the trim, (66, number of identified parameters)."""
    own = replace(HFA, equations=Equations(variant))
    found = _derivatives(own.layout)([point.values[name] for name in own.variables], list(parameters.values))
    entries_by_v, entries_by_p, rates_by_v, rates_by_p = map(np.array, found)
    free = [own.variables.index(name) for name in condition.free]
    rows = [STATES.index(name) for name in condition.equations[0]]
    free_by_p = -np.linalg.lstsq(rates_by_v[np.ix_(rows, free)], rates_by_p[rows], rcond=None)[0]
    total = entries_by_p + entries_by_v[:, free] @ free_by_p
    return np.asarray(total[:, [Parameters._fields.index(name) for name in parameters.identified]])


@cache
def _derivatives(layout: Layout) -> ca.Function:
    """(v, p) -> ∂ vec(A, B)/∂v, ∂ vec(A, B)/∂p, ∂f/∂v, ∂f/∂p, with the paper's six states in A and B; v: the variables
    of a trim, on which the state and the input depend."""
    (x, u, p), v = layout.symbols("x", "u", "p"), ca.SX.sym("v", len(layout.variables))
    f, _ = layout.expressions(list(map(components, (x, u, p))), ())
    A, B = ca.jacobian(f, x)[LINEAR_ROWS, LINEAR_ROWS], ca.jacobian(f, u)[LINEAR_ROWS, :]
    entries = ca.vertcat(ca.vec(ca.densify(A)), ca.vec(ca.densify(B)))
    at = layout.in_variables(dict(zip(layout.variables, ca.vertsplit(v), strict=True)), p, ())[:2]
    jacobians = [ca.jacobian(part, by) for part in ca.substitute([entries, f], [x, u], at) for by in (v, p)]
    return ca.Function("entry_derivatives", [v, p], list(map(ca.densify, jacobians)))
