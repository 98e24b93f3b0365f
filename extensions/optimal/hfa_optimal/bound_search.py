"""Search for a lower bound of the cost of flights."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hfa_boxes.check.cost_checker import equilibrium_of
from hfa_boxes.search.cost import CostBound, CostSearch
from hfa_flight.initial_box import usual_box
from hfa_flight.problem import FlightProblem
from hfa_optimal.bound import plant_of, unknowns_of
from hfa_support.progress import Progress


def bound_search(
    problem: FlightProblem,
    *,
    degree: int,
    margin: float,
    seconds: float,
    progress: Progress | None = None,
    save: Callable[[CostBound], None] | None = None,
) -> CostSearch:
    """Return a search for a lower bound of the cost of flights that begin in the box of
    `usual_box`.

    degree: degree of the polynomial W, the lower bound as a function of the initial condition
    margin: relative distance of W below the linear quadratic cost, to second order
    seconds: limit of processor time, s
    save: function called with the bound after each proved piece of the box, or None
    """
    plant = plant_of(problem)
    solved = unknowns_of(problem, plant)
    trim = np.array([*plant.trim.values(), *plant.inputs.values()])
    return CostSearch(
        plant,
        equilibrium_of(plant, trim, solved),
        solved,
        (problem.Q, problem.R, problem.P),
        usual_box(problem),
        degree=degree,
        margin=margin,
        seconds=seconds,
        progress=progress,
        save=save,
    )
