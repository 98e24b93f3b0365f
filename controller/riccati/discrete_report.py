"""What the exact solution of a game in discrete time says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.game.discrete_game import DiscreteGame
from controller.riccati.discrete import DiscreteSolution, minimum_delta_discrete, solve_discrete
from controller.riccati.smallest_delta import DeltaMin
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress
from hfa_support.reporting.checks import checks_block
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import matrix_table

SCHEMA = "hfa.discrete-solution/1"


@dataclass(frozen=True, eq=False, repr=False)
class AnalysedDiscreteGame(Shown):
    """A certified solution in discrete time and the smallest delta that has one."""

    solution: DiscreteSolution
    delta_min: DeltaMin


def analyse_discrete(
    problem: DiscreteGame, progress: Progress | None = None
) -> AnalysedDiscreteGame:
    """The certified solution of a game in discrete time, and its smallest delta.

    progress: called during the search for the smallest delta

    NoSolutionError where `solve_discrete` raises it.
    """
    solution = solve_discrete(problem, progress)
    return AnalysedDiscreteGame(solution, minimum_delta_discrete(problem, progress))


def discrete_report(analysed: AnalysedDiscreteGame) -> Report:
    """The report of a solution: P, K, the checks of its certificate and the spectral radii of
    A - B K and of sqrt(discount) (A - B K)."""
    solution = analysed.solution
    states = solution.names.states
    inputs = solution.names.inputs
    delta = solution.game.delta
    margin = analysed.delta_min.margin(delta)
    stabilizes = "stabilizes" if solution.radius < 1.0 else "does NOT stabilize"
    eigenvalues = np.linalg.eigvals(solution.game.A - solution.game.B @ solution.K)
    return Report(
        title=f"Exact game solution in discrete time for {solution.names.origin}\n"
        f"delta {delta:.6g}, smallest possible {analysed.delta_min.value:.7g}, margin {margin:.4g},"
        f" discount {solution.discount:g} a step",
        parts=(
            matrix_table("P", states, states, solution.P),
            matrix_table("K", inputs, states, solution.K),
            f"u = -K x {stabilizes}: A - B K has the spectral radius {solution.radius:.7g},"
            f" sqrt(discount) (A - B K) {solution.discounted_radius:.7g}",
            checks_block(solution.certificate.checks),
        ),
        data={
            "schema": SCHEMA,
            "states": list(states),
            "inputs": list(inputs),
            "P": solution.P.tolist(),
            "K": solution.K.tolist(),
            "disturbance_gain": solution.disturbance_gain.tolist(),
            "H": solution.H.tolist(),
            "delta": finite_or_none(delta),
            "discount": solution.discount,
            "delta_min": analysed.delta_min.value,
            "delta_margin": finite_or_none(margin),
            "certificate": solution.certificate.to_dict(),
            "spectral_radius": solution.radius,
            "discounted_spectral_radius": solution.discounted_radius,
            "closed_loop_eigenvalues": [[value.real, value.imag] for value in eigenvalues],
        },
    )
