"""The optimizer's proposal for the best flight of the GTM, compared with rockit.

The equations, cost, initial guess and number of intervals are equal. Both programs use Radau
collocation of degree 2 and IPOPT with equal tolerance. The project narrows the limits of the states
by a margin and has inputs that are linear in each interval. Without rockit
(`pip install rockit-meco`) there are no figures.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from benchmarks.report import Limit, Row, in_turn, shortest
from hfa_aircraft.loading import load_model
from hfa_flight.initial_box import drawn_starts
from hfa_flight.problem import FlightProblem, flight_problem
from hfa_optimal.collocation import (
    DEGREE,
    OPTIONS,
    Equations,
    Transcription,
    collocation_points,
    mesh as growing,
)
from trim.point.solve import trim

_GTM = Path(__file__).parents[1] / "examples" / "gtm.py"
_INTERVALS = 50
#: Assumed number of initial conditions, for which derivatives are compiled if a compiler exists.
_STARTS = 50
_SECONDS = 30.0
#: Names of the functions that IPOPT evaluates, in CasADi's statistics.
_EVALUATIONS = ("nlp_f", "nlp_g", "nlp_grad_f", "nlp_jac_g", "nlp_hess_l")


def _best_flight(quick: bool) -> list[Row]:
    """Return the comparison of the project's best flight of the GTM with rockit's."""
    if importlib.util.find_spec("rockit") is None:
        return []
    model = load_model(f"{_GTM}:GTM")
    problem = flight_problem(model, trim(model))
    (start,) = drawn_starts(problem, 1, 0)
    transcription = Transcription(problem, _INTERVALS, Equations.of(problem, _STARTS))
    ours = _ours(transcription, start)
    timing = in_turn(ours, _rockit(problem, start), repeats=1 if quick else 11)
    job = f"a proposal for the best flight of the GTM, {_INTERVALS} intervals"
    limit = _limit(transcription, ours, repeats=1 if quick else 7)
    return [Row(job, "rockit 0.6 (DirectCollocation, IPOPT)", timing, 3.0, limit=limit)]


def _ours(transcription: Transcription, start: np.ndarray) -> Callable[[], Any]:
    """Return a function that finds the best flight with the project's transcription."""
    lengths = growing(_SECONDS, _INTERVALS, 1.0, 0.005)
    ends = np.append(0.0, np.cumsum(lengths))
    inside = (ends[:-1, None] + lengths[:, None] * collocation_points()[1:]).ravel()
    z = np.zeros((len(inside), len(start)))
    v = np.zeros((_INTERVALS + 1, len(transcription.problem.inputs)))

    def solve() -> None:
        assert transcription.solve(start, lengths, z, v).feasible

    return solve


def _limit(transcription: Transcription, solve: Callable[[], Any], repeats: int) -> Limit:
    """Return the least time: IPOPT's evaluations, and a KKT factorization per iteration."""
    solver = transcription._solver
    times = []
    for _ in range(repeats):
        solve()
        stats = solver.stats()
        times.append(sum(stats[f"t_wall_{name}"] for name in _EVALUATIONS))
    J = _drawn(solver.get_function("nlp_jac_g").sparsity_out(1))
    H = _drawn(solver.get_function("nlp_hess_l").sparsity_out(0))
    H = H + H.T + sp.diags(1.0 + abs(H + H.T).sum(axis=1).A1)
    kkt = sp.bmat([[H, J.T], [J, -sp.eye(J.shape[0])]], format="csc")
    # The matrix is quasi-definite and needs no pivoting.
    of_symmetric = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    factor = partial(splu, kkt, permc_spec="MMD_AT_PLUS_A", **of_symmetric)
    factorizations = stats["iter_count"] * shortest(factor, repeats=repeats)
    return Limit(min(times) + factorizations, "the evaluations and factorizations of IPOPT")


def _drawn(pattern: ca.Sparsity) -> sp.csc_matrix:
    """Return a sparse matrix with a given sparsity pattern and normally distributed entries."""
    values = np.random.default_rng(0).normal(size=pattern.nnz())
    return sp.csc_matrix((values, pattern.row(), pattern.colind()), shape=pattern.shape)


def _rockit(problem: FlightProblem, start: np.ndarray) -> Callable[[], Any]:
    """Return a function that finds the best flight with rockit."""
    from rockit import DirectCollocation, GeometricGrid, Ocp

    of_states, of_inputs = problem.sizes
    Q, R, P = (ca.DM(weight) for weight in problem.scaled_weights())
    ocp = Ocp(T=_SECONDS)
    z = ocp.state(len(of_states))
    v = ocp.control(len(of_inputs))
    ocp.set_der(z, problem.rates(ca.vertcat(z, v)))
    ocp.add_objective(ocp.integral(ca.bilin(Q, z, z) + ca.bilin(R, v, v)))
    ocp.add_objective(ocp.at_tf(ca.bilin(P, z, z)))
    for signals, sizes, limits in (
        (z, of_states, problem.state_limits),
        (v, of_inputs, problem.input_limits),
    ):
        for row, (low, high) in enumerate(zip(*(limits / sizes), strict=True)):
            if np.isfinite([low, high]).all():
                ocp.subject_to(float(low) <= (signals[row] <= float(high)))
    ocp.subject_to(ocp.at_t0(z) == start / of_states)
    growth = float(np.clip(_SECONDS / _INTERVALS, 4.0, 60.0))
    grid = GeometricGrid(growth)
    ocp.method(DirectCollocation(N=_INTERVALS, M=1, degree=DEGREE, scheme="radau", grid=grid))
    names = ("print_time", "ipopt.print_level", "ipopt.sb", "ipopt.tol")
    ocp.solver("ipopt", {name: OPTIONS[name] for name in names})
    ocp.solve()
    return ocp.solve


JOBS = {"best_flight": _best_flight}
