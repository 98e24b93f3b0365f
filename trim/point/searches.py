"""Searches for a trim, used if Newton's method fails from the default initial point.

The searches begin at the least-squares solution within the limits, or at other points. With more
unknowns than equations, the searches minimize the control effort.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.signals import engines_among
from hfa_support.errors import BadInputError
from trim.point.problem import TrimProblem
from trim.point.status import BALANCE
from trim.point.system import Structure, equations as equations_of

#: Distance from the limits at which a least-squares search begins, in scaled units. Its steps are
#: proportional to this distance, so that it would not leave a limit.
_INSIDE = 1e-9


def after_newton(problem: TrimProblem, guess: np.ndarray) -> Iterator[tuple[np.ndarray, int]]:
    """Yield the end of each further search, after Newton's method from the guess has failed: scaled
    unknowns (k,), which need not be a trim, and the number of the initial point.

    The searches have these initial points, in this order:

    - 0: Newton's method from the least-squares solution within the limits
    - 0: the least-squares solution itself
    - 1, 2, ...: bounded Newton's method from other initial points

    guess: initial point of the first search, (k,)
    """
    problem.at(guess)  # raises where the equations have no finite value: no search is made then
    nearest = _bounded_least_squares(problem, guess)
    yield problem.newton(nearest), 0
    yield nearest, 0
    for number, z in enumerate(problem.ends_within([*problem.starts(guess)]), start=1):
        yield z, number


def of_least_effort(problem: TrimProblem, guess: np.ndarray) -> Iterator[tuple[np.ndarray, int]]:
    """Yield the end of each search for a trim of least effort, as `after_newton` does.

    The searches have these initial points, in this order:

    - 0: from the guess, with equal inputs of all engines, then without
    - 0: from the least-squares solution within the limits, if this solution is a trim
    - 0: the least-squares solution itself
    - 1, 2, ...: from other initial points

    guess: first initial point, (k,)
    """
    problem.at(guess)  # raises where the equations have no finite value: no search is made then
    yield _least_effort(problem, guess, apart=0.0), 0
    yield _least_effort(problem, guess), 0
    nearest = _polished(problem, _bounded_least_squares(problem, guess))
    if problem.solved(nearest):
        yield _least_effort(problem, nearest), 0
    yield nearest, 0
    for number, start in enumerate(problem.starts(guess), start=1):
        yield _least_effort(problem, start), number


def _polished(problem: TrimProblem, z: np.ndarray) -> np.ndarray:
    """Return the unknowns (k,) after Newton's method from z, (k,), with those at a limit fixed."""
    system = problem.system
    z = problem.clip(z)
    at_lowest, at_highest = system.limits.at_limits(z * system.scales)
    z[at_lowest] = system.lowest[at_lowest]
    z[at_highest] = system.highest[at_highest]
    moving = np.flatnonzero(~(at_lowest | at_highest))
    if not moving.size:
        return z
    return problem.newton(z, moving)


def _bounded_least_squares(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """Return the scaled unknowns (k,) within the limits that minimize |r|², near a guess (k,)."""
    from scipy.optimize import least_squares

    def residual(z: np.ndarray) -> np.ndarray:
        """Return the scaled residuals (e,), inf outside the range of the model."""
        try:
            return problem.at(z).residual
        except (BadInputError, FloatingPointError):
            return np.full(len(problem.system.equations.rows), np.inf)

    # SciPy wants distinct limits, and at a limit itself, the steps of its method would be 0.
    lowest = problem.system.lowest
    highest = np.maximum(problem.system.highest, lowest + 4.0 * _INSIDE)
    inside = np.clip(guess, lowest + _INSIDE, highest - _INSIDE)
    # The search stops at the rounding of doubles; `TrimProblem.solved` judges its end.
    tight: Any = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15, "bounds": (lowest, highest)}
    found = least_squares(residual, inside, jac=lambda z: problem.at(z).jacobian, **tight)
    return problem.clip(found.x)


_IPOPT: dict[str, Any] = {
    "print_level": 0,
    "sb": "yes",
    "tol": BALANCE,
    "bound_relax_factor": 0.0,
    "max_iter": 200,
}


@lru_cache(maxsize=16)
def _effort_program(structure: Structure) -> ca.Function:
    """Return the IPOPT solver for the z with the least Σ z_i² of the free inputs."""
    # The constraints g are the residuals that the unknowns affect, and the watched signals: states
    # and outputs that have limits, but are neither imposed nor unknown; and the differences of the
    # inputs of engines from the first one.
    e = equations_of(structure)
    engines = [e.z[e.unknowns.index(name)] for name in engines_among(e.unknowns)]
    apart = [engine - engines[0] for engine in engines[1:]]
    inputs = [i for i, name in enumerate(e.unknowns) if name in structure.layout.names.inputs]
    scales = ca.DM([signal.scale for signal in structure.watched])
    program = {
        "x": e.z,
        "p": e.c,
        "f": ca.sumsqr(e.z[inputs]),
        "g": ca.vertcat(e.residual[: e.affected_count], e.y / scales, *apart),
    }
    options: dict[str, Any] = {
        "print_time": False,
        "show_eval_warnings": False,
        "calc_lam_p": False,
        "ipopt": _IPOPT,
    }
    try:
        return ca.nlpsol("effort", "ipopt", program, options)
    except RuntimeError as error:
        if "Derivatives cannot be calculated" not in str(error):
            raise
        # A compiled function, such as an FMU, has no second derivatives.
        first_order = {**_IPOPT, "hessian_approximation": "limited-memory"}
        return ca.nlpsol("effort", "ipopt", program, {**options, "ipopt": first_order})


def _least_effort(problem: TrimProblem, guess: np.ndarray, apart: float = math.inf) -> np.ndarray:
    """Return the z (k,) with the least Σ z_i² of the free inputs within limits, near a guess.

    apart: largest difference of the inputs of engines
    """
    # The result need not be a trim. `_effort_program` bounds the residuals and watched signals.
    system = problem.system
    balanced = np.zeros(system.affected_count)
    scales = np.array([signal.scale for signal in system.structure.watched])
    program = _effort_program(system.structure)
    between = np.full(program.size1_out("g") - len(balanced) - len(scales), apart)
    solution = program(
        x0=guess,
        p=problem.c[0],
        lbx=system.lowest,
        ubx=system.highest,
        lbg=np.concatenate([balanced, system.watched.lowest / scales, -between]),
        ubg=np.concatenate([balanced, system.watched.highest / scales, between]),
    )
    return _polished(problem, np.array(solution["x"]).ravel())
