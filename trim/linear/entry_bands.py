"""How uncertain each entry of A and B is: the rounding of the print, propagated through the parameters and the trim."""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np

from hfa_model.dynamics import state_rates, symbols
from hfa_model.parameters import Parameters, ParameterSet, default_parameters
from hfa_model.variants import Variant, variant_named
from hfa_model.vectors import INPUTS, LINEAR_ROWS, LINEAR_STATES, STATES
from hfa_support.errors import BadInputError
from trim.linear.linear_model import Bands, LinearModel
from trim.point.condition import TrimCondition
from trim.point.operating_point import OperatingPoint

#: Parameters identified with another seed, or on another machine, differ by less than this from the packaged ones.
_SAME = 1e-7


def bands_known(parameters: ParameterSet) -> bool:
    """Whether these parameters have bands: the identified values (to 1e-7), with their covariance.

    The covariance belongs to what the print gives. Beside an edited value it is the uncertainty of another aircraft.
    """
    same = np.allclose(parameters.values, default_parameters().values, rtol=_SAME, atol=0.0)
    return same and parameters.covariance.size > 0


def entry_bands(parameters: ParameterSet, condition: TrimCondition, model: LinearModel) -> Bands:
    """Bands of the entries of a six-state linear model, made with these parameters at a trim of this condition.

    rounding: sqrt(diag(J C J')), J = ∂(A, B)/∂p + ∂(A, B)/∂v dv/dp, dv/dp = -(∂f/∂v)⁻¹ ∂f/∂p (implicit function
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
    rounding = np.sqrt(np.einsum("ij,jk,ik->i", jacobian, parameters.covariance, jacobian))
    return Bands(*_split(rounding))


def _total_derivative(
    parameters: ParameterSet, variant: Variant, condition: TrimCondition, point: OperatingPoint
) -> np.ndarray:
    """d vec(A, B) / d(identified parameters) along the trim, (66, number of identified parameters)."""
    p = np.array(parameters.values)
    entries_by_point, entries_by_p, rates_by_point, rates_by_p = map(
        np.array, _derivatives(variant)(np.array(point.states), np.array(point.inputs), p)
    )
    moves = np.column_stack([_move(name) for name in condition.free])
    rows = [STATES.index(name) for name in condition.equations[0]]
    free_by_p = -np.linalg.lstsq(rates_by_point[rows] @ moves, rates_by_p[rows], rcond=None)[0]
    total = entries_by_p + entries_by_point @ moves @ free_by_p
    return np.asarray(total[:, [Parameters._fields.index(name) for name in parameters.identified]])


def _move(name: str) -> np.ndarray:
    """How (X, U) moves with one free variable: θ = α + γ follows both."""
    order = STATES + INPUTS
    direction = np.zeros(len(order))
    direction[order.index("pitch" if name == "gamma" else name)] = 1.0
    if name == "alpha":
        direction[order.index("pitch")] = 1.0
    return direction


@cache
def _derivatives(variant: Variant) -> ca.Function:
    """(x, u, p) -> ∂ vec(A, B)/∂(x, u), ∂ vec(A, B)/∂p, ∂f/∂(x, u), ∂f/∂p, with the paper's six states in A and B."""
    x, u, p = symbols()
    f = state_rates(x, u, p, variant)
    A, B = ca.jacobian(f, x)[LINEAR_ROWS, LINEAR_ROWS], ca.jacobian(f, u)[LINEAR_ROWS, :]
    entries, point = ca.vertcat(ca.vec(ca.densify(A)), ca.vec(ca.densify(B))), ca.vertcat(x, u)
    jacobians = [ca.jacobian(part, by) for part in (entries, f) for by in (point, p)]
    return ca.Function("entry_derivatives", [x, u, p], [ca.densify(jacobian) for jacobian in jacobians])


def _split(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    n, m = len(LINEAR_STATES), len(INPUTS)
    # CasADi stacks columns.
    return vector[: n * n].reshape(n, n, order="F"), vector[n * n :].reshape(n, m, order="F")
