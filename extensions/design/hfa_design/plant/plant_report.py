"""Report of `hfa solve` for a generalized plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controller.riccati.balancing import is_hurwitz, spectrum
from controller.riccati.certificate import Certificate
from controller.riccati.smallest_delta import DeltaMin
from hfa_design.plant.generalized_plant import (
    GeneralizedPlant,
    OutputFeedback,
    StateFeedback,
    closed_plant,
    solve_plant,
    stored_plant,
)
from hfa_support.arguments import checks_arguments
from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result, Roots, given
from hfa_support.reporting.text import Table, controller_tables, eigenvalue_text, numbered

#: Default delta / delta_min. Nearer to 1, the poles of the controller become ever faster.
USUAL_MARGIN = 1.01


#: Names of the rows and of the columns of a matrix.
Names = tuple[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PlantSolution(Result, Reported):
    """Controller of a generalized plant, with its delta, the smallest delta and the closed loop.

    plant: name of the plant.
    problem: the plant.
    smallest: delta_min of the plant.
    solution: the controller.
    closed_loop_eigenvalues: 1/s.
    warnings: notes on the result.
    """

    schema = "hfa.plant-solution/1"

    plant: str
    problem: GeneralizedPlant
    smallest: DeltaMin
    solution: OutputFeedback | StateFeedback
    closed_loop_eigenvalues: Roots
    warnings: Sequence[str]

    @property
    def delta(self) -> float:
        """Upper bound of the gain from w to z."""
        return self.solution.delta

    @property
    def checks(self) -> tuple[Check, ...]:
        """Checks of the certificates and of the closed loop."""
        return self.solution.checks

    @property
    def delta_margin(self) -> float:
        """Ratio delta / delta_min."""
        return self.smallest.margin(self.solution.delta)

    @property
    def certificate(self) -> Certificate:
        """Checks that certify the controller, and whether all pass."""
        return Certificate(self.solution.checks)

    @property
    def law(self) -> str:
        """Equation of the controller, as text."""
        raise NotImplementedError

    def loop(self, controller: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the matrix of the closed loop with given matrices of the controller."""
        raise NotImplementedError

    @property
    def matrices(self) -> dict[str, Names]:
        """Names of the rows and columns of each matrix of the controller, by name of the matrix."""
        raise NotImplementedError

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "plant": self.plant,
            "delta_min": self.smallest.value,
            "delta_min_refused": self.smallest.refused,
            "delta_min_condition": self.smallest.condition,
            "closed_loop_eigenvalues": self.closed_loop_eigenvalues,
            "warnings": self.warnings,
            "delta": self.delta,
            "checks": self.checks,
            "delta_margin": self.delta_margin,
            "certificate": self.certificate,
        }

    def report(self) -> Report:
        """Return the report: equation and matrices of the controller, closed loop and checks."""
        matrices = controller_tables(
            {name: (*names, getattr(self.solution, name)) for name, names in self.matrices.items()},
            lambda printed: is_hurwitz(self.loop(printed)),
        )
        poles = self.closed_loop_eigenvalues
        upper = ", ".join(eigenvalue_text(value) for value in poles if value.imag >= 0)
        limits = f"delta {self.solution.delta:.6g}, smallest possible {self.smallest.value:.7g}"
        if self.smallest.condition != "none":
            limits += f", limited by the {self.smallest.condition}"
        return Report(
            title=f"{self.law} for {self.plant}: certified\n{limits}",
            parts=(*matrices, f"closed loop, 1/s: {upper}", checks_block(self.solution.checks)),
            data=self.as_data(),
            records=self._records(),
        )

    def _records(self) -> Table:
        """Return a table with one row for each entry of each matrix of the controller."""
        rows = []
        for name, (row_names, column_names) in self.matrices.items():
            matrix = getattr(self.solution, name)
            for i, row in enumerate(row_names):
                for j, column in enumerate(column_names):
                    rows.append((name, row, column, matrix[i, j]))
        return Table(("matrix", "row", "column", "value"), rows)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class OutputSolution(PlantSolution):
    """Controller of a plant with measurements y."""

    solution: OutputFeedback

    @property
    def feedback(self) -> str:
        """Kind of feedback: state (u = -K x, P) or output (xk' = Ak xk + Bk y, u = Ck xk + Dk
        y).
        """
        return "output"

    @property
    def law(self) -> str:
        """Equation of the controller, as text."""
        return "Output feedback xk' = Ak xk + Bk y, u = Ck xk + Dk y"

    def loop(self, controller: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the matrix of the closed loop with given Ak, Bk, Ck and Dk."""
        Ak, Bk, Ck, Dk = (controller[name] for name in ("Ak", "Bk", "Ck", "Dk"))
        return closed_plant(self.problem, (Ak, Bk, Ck, Dk))[0]

    @property
    def matrices(self) -> dict[str, Names]:
        """Names of the rows and columns of each matrix of the controller, by name of the matrix."""
        own = numbered("xk", len(self.solution.Ak))
        measured = numbered("y", self.solution.Bk.shape[1])
        inputs = numbered("u", len(self.solution.Ck))
        return {
            "Ak": (own, own),
            "Bk": (own, measured),
            "Ck": (inputs, own),
            "Dk": (inputs, measured),
        }

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return (
            super().contents()
            | {"feedback": self.feedback}
            | given(
                Ak=self.solution.Ak,
                Bk=self.solution.Bk,
                Ck=self.solution.Ck,
                Dk=self.solution.Dk,
                X=self.solution.X,
                Y=self.solution.Y,
                coupling=self.solution.coupling,
            )
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class StateSolution(PlantSolution):
    """Gain of a plant whose states are measured."""

    solution: StateFeedback

    @property
    def feedback(self) -> str:
        """Kind of feedback: state (u = -K x, P) or output (xk' = Ak xk + Bk y, u = Ck xk + Dk
        y).
        """
        return "state"

    @property
    def law(self) -> str:
        """Equation of the controller, as text."""
        return "State feedback u = -K x"

    def loop(self, controller: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the matrix A - B2 K of the closed loop with a given K."""
        return self.problem.A - self.problem.B2 @ controller["K"]

    @property
    def matrices(self) -> dict[str, Names]:
        """Names of the rows and columns of P and of K."""
        states = numbered("x", len(self.solution.P))
        inputs = numbered("u", len(self.solution.K))
        return {"P": (states, states), "K": (inputs, states)}

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return (
            super().contents()
            | {"feedback": self.feedback}
            | given(
                P=self.solution.P,
                K=self.solution.K,
                disturbance_gain=self.solution.disturbance_gain,
            )
        )


def solved_plant(file: Path, arrays: dict[str, Any], delta: float | None) -> Report:
    """Return the report on the certified controller of a generalized plant in a file.

    file: file of the plant, for messages
    arrays: content of the file
    delta: bound of the gain, or None for the bound in the file

    Raises BadInputError if an entry of the file is missing or invalid. Raises NoSolutionError if
    there is no certified controller.
    """
    plant, stored_delta, notes = stored_plant(file, arrays)
    bound = stored_delta if delta is None else delta
    return solution_of_plant(plant, bound, str(file), notes).report()


@checks_arguments
def solution_of_plant(
    plant: GeneralizedPlant, delta: float | None, origin: str, notes: Sequence[str] = ()
) -> PlantSolution:
    """Return the certified controller of a generalized plant, with delta_min and the closed loop.

    delta: bound of the gain, or None for `USUAL_MARGIN` times delta_min, or 1 if delta_min is 0
    origin: name of the plant
    notes: notes on the file of the plant

    Raises NoSolutionError if there is no certified controller. The message names the assumption or
    condition that fails.
    """
    smallest = plant.minimum_delta()
    if delta is None:
        delta = USUAL_MARGIN * smallest.value or 1.0
    solution = solve_plant(plant, delta)
    shared: dict[str, Any] = {
        "plant": origin,
        "problem": plant,
        "smallest": smallest,
        "warnings": notes,
    }
    if isinstance(solution, StateFeedback):
        loop = plant.A - plant.B2 @ solution.K
        poles = spectrum(loop)
        return StateSolution(solution=solution, closed_loop_eigenvalues=poles, **shared)
    controller = (solution.Ak, solution.Bk, solution.Ck, solution.Dk)
    loop, *_ = closed_plant(plant, controller)
    poles = spectrum(loop)
    return OutputSolution(solution=solution, closed_loop_eigenvalues=poles, **shared)
