"""Accurate solutions X of the Riccati equation of one normal form, by Schur form and by doubling.

The solutions are not tested here.
"""

from __future__ import annotations

import math
import warnings

import numpy as np

from controller.riccati.balancing import is_hurwitz
from controller.riccati.derivations import by_doubling
from controller.riccati.normal_form import NormalForm, stable_basis
from hfa_support.errors import NoSolutionError

#: Largest number of Newton steps after the Schur form. Each gains about 16 digits minus those lost
#: to the condition number; two are enough except near the smallest delta.
REFINEMENTS = 12
#: A relative correction of this size is rounding.
ROUNDING = 4.0 * float(np.finfo(float).eps)
_NO_GRAPH = "the Hamiltonian has no stable subspace that is the graph of a P"


def by_schur(form: NormalForm) -> np.ndarray:
    """Return the solution X, (n, n), of a Riccati equation from the Schur form of its Hamiltonian.

    The solution is refined by Newton's method (`refined`).

    Source: Laub, IEEE Trans. Automatic Control 24 (1979), 913-921.

    Raises NoSolutionError if the stable subspace [V1; V2] does not have dimension n, if V1 is
    singular, or if the equation of a Newton correction is singular within rounding.
    """
    return refined(form, unrefined(form))


def unrefined(form: NormalForm) -> np.ndarray:
    """Return the solution X, (n, n), from the Schur form of the Hamiltonian, without refinement.

    If Q = 0 and A is Hurwitz, the result is exactly 0, without the rounding errors of a Schur form.

    Raises NoSolutionError if the stable subspace [V1; V2] does not have dimension n, or V1 is
    singular.
    """
    if not form.Q.any() and is_hurwitz(form.A):
        return np.zeros_like(form.A)
    basis = stable_basis(form.hamiltonian)
    if basis is None:  # the dimension of the stable subspace is not n
        raise NoSolutionError(_NO_GRAPH)
    n = len(form.A)
    try:
        return np.linalg.solve(basis[:n].T, basis[n:].T)
    except np.linalg.LinAlgError as error:
        raise NoSolutionError(_NO_GRAPH) from error


def refined(form: NormalForm, X: np.ndarray) -> np.ndarray:
    """Return the solution X of a Riccati equation after Newton (Kleinman) corrections X <- X + Z.

    Each correction solves (A - S X)'Z + Z (A - S X) + residual(X) = 0. If the condition number of
    this equation is near 1e16, the corrections decrease and then increase. The X after the smallest
    correction is returned.

    form: normal form of the game
    X: (n, n), approximate solution of the Riccati equation

    Raises NoSolutionError if the equation of a correction is singular within rounding.
    """
    from scipy.linalg import LinAlgError, solve_continuous_lyapunov

    X = (X + X.T) / 2.0
    best = X
    smallest = math.inf
    for _ in range(REFINEMENTS):
        try:
            with warnings.catch_warnings():
                # SciPy warns of a singular Lyapunov equation.
                warnings.simplefilter("error", RuntimeWarning)
                Z = solve_continuous_lyapunov((form.A - form.S @ X).T, -form.residual(X))
        except (LinAlgError, ValueError, RuntimeWarning) as error:
            raise NoSolutionError(
                "the equation of Newton's step for P is singular within rounding"
            ) from error
        X = X + (Z + Z.T) / 2.0
        correction = float(np.abs(Z).max())
        if correction < smallest:
            best = X
            smallest = correction
        if correction <= ROUNDING * np.abs(X).max():
            break
    return best


def by_refined_doubling(form: NormalForm) -> np.ndarray:
    """Return the solution X, (n, n), of a Riccati equation by doubling, refined by Newton's method.

    Raises NoSolutionError if the equation of a Newton correction is singular within rounding.
    """
    with np.errstate(all="ignore"):
        X = by_doubling(form[None], np.linalg.eigvals(form.hamiltonian[None]))
        return refined(form, X[0])
