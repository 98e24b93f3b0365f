"""Report of the exact solution of a discrete-time game."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from controller.discrete.solution import DiscreteSolution, minimum_delta_discrete, solve_discrete
from controller.game.discrete_game import DiscreteGame
from controller.riccati.smallest_delta import DeltaMin
from controller.riccati.solution_report import sensitivity_warning
from hfa_support.progress import Progress
from hfa_support.reporting.checks import checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result, Roots, stored, stored_parts
from hfa_support.reporting.text import controller_tables, matrix_table


@dataclass(frozen=True, eq=False, repr=False)
class AnalysedDiscreteGame(Result, Reported):
    """Certified solution and smallest delta of a discrete-time game.

    solution: the certified solution.
    delta_min: the smallest delta with a solution.
    """

    schema = "hfa.discrete-solution/1"
    made_by = "hfa solve, of a plant in discrete time"

    solution: DiscreteSolution = field(
        metadata=stored_parts(
            states="names.states",
            inputs="names.inputs",
            P="P",
            K="K",
            disturbance_gain="disturbance_gain",
            H="H",
            delta="game.delta",
            discount="discount",
            certificate="certificate",
            spectral_radius="radius",
            discounted_spectral_radius="discounted_radius",
        )
    )
    delta_min: DeltaMin = field(metadata=stored_parts(delta_min="value"))

    @property
    @stored()
    def delta_margin(self) -> float:
        """Ratio delta / delta_min of a game."""
        return self.delta_min.margin(self.solution.game.delta)

    @property
    @stored()
    def closed_loop_eigenvalues(self) -> Roots:
        """Eigenvalues of A - B K, (n,), in discrete time."""
        step = self.solution.game
        return np.linalg.eigvals(step.A - step.B @ self.solution.K)


def analyse_discrete(
    problem: DiscreteGame, progress: Progress | None = None
) -> AnalysedDiscreteGame:
    """Return the certified solution and the smallest delta of a discrete-time game.

    progress: called during the search for the smallest delta

    Raises NoSolutionError if no solution is certified (`solve_discrete`).
    """
    solution = solve_discrete(problem, progress)
    return AnalysedDiscreteGame(solution, minimum_delta_discrete(problem, progress))


def discrete_report(analysed: AnalysedDiscreteGame) -> Report:
    """Return the report of a solved discrete-time game.

    The report contains P, K, the spectral radii and the checks of the certificate.
    """
    solution = analysed.solution
    states = solution.names.states
    inputs = solution.names.inputs
    delta = solution.game.delta
    stabilizes = "stabilizes" if solution.radius < 1.0 else "does NOT stabilize"
    return Report(
        title=f"Exact game solution in discrete time for {solution.names.origin}: certified\n"
        f"delta {delta:.6g}, smallest possible {analysed.delta_min.value:.7g}, "
        f"margin {analysed.delta_margin:.4g}, discount {solution.discount:g} a step",
        parts=(
            matrix_table("P", states, states, solution.P),
            *controller_tables({"K": (inputs, states, solution.K)}, solution.has_finite_cost),
            f"u = -K x {stabilizes}: A - B K has the spectral radius {solution.radius:.7g},"
            f" sqrt(discount) (A - B K) {solution.discounted_radius:.7g}",
            *sensitivity_warning(solution.certificate),
            checks_block(solution.certificate.checks),
        ),
        data=analysed.as_data(),
    )
