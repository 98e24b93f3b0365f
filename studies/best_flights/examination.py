"""Best flights of twelve aircraft from many random initial conditions.

The study counts the flights that are found, and the failed searches by reason. The cost of each
flight is computed again by an integrator of SciPy with the model's equations. The study writes
FOLDER/examination.json after each aircraft, and an interrupted run can be continued.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

import hfa
from hfa_aircraft.layout import components
from hfa_flight.initial_box import drawn_starts
from hfa_flight.problem import FlightProblem, flight_problem
from hfa_optimal.flights import SimulatedFlight
from hfa_optimal.search import BestFlights
from hfa_optimal.smooth import has_kinks
from hfa_support.errors import NoSolutionError
from hfa_support.native.bound import BoundFunction
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from studies.finished import row_by_row

#: Name -> source of the aircraft, see `problem_of`.
AIRCRAFT = {
    "GTM": "examples/gtm.py:GTM",
    "pendulum": "examples/pendulum.py:PENDULUM",
    "Navion": "examples/navion.py:NAVION",
    "F-16": "examples/f16.py:F16",
    "HFA, published": "published",
    "HFA, newton": "newton",
    "c172p (JSBSim)": "jsbsim:c172p",
    "737 (JSBSim)": "jsbsim:737",
    "A4 (JSBSim)": "jsbsim:A4",
    "T38 (JSBSim)": "jsbsim:T38",
    "Concorde (JSBSim)": "jsbsim:Concorde",
    "B747 (JSBSim)": "jsbsim:B747",
}
#: Initial conditions of each aircraft.
_STARTS = 50
#: Dihedral angle of the flexible aircraft, deg.
_DIHEDRAL = 10.0
#: Seed of the initial conditions.
_SEED = 0


def problem_of(source: str) -> FlightProblem:
    """Return the problem of flights to a trim of an aircraft.

    source: "published" or "newton" for the HFA at the dihedral angle `_DIHEDRAL` with the paper's Q
        and R, or a file of an aircraft for its default trim and weights
    """
    if source not in ("published", "newton"):
        model = hfa.load_model(source)
        return flight_problem(model, hfa.trim(model))
    model = hfa.aircraft(dynamics=source)
    point = hfa.trim(model, hold={"dihedral": np.radians(_DIHEDRAL)})
    game = hfa.paper.published_game(hfa.linearize(model, point))
    return flight_problem(model, point, game.Q, game.R)


@cache
def rates_of(problem: FlightProblem) -> BoundFunction:
    """Return the function from states X and inputs U to dX/dt, made from the equations of the
    model.
    """
    model = problem.model
    X = ca.SX.sym("X", len(model.states))
    U = ca.SX.sym("U", len(model.inputs))
    vectors = components(X), components(U), components(ca.DM(model.p))
    rates, _ = model.layout.expressions(vectors, ())
    return BoundFunction(ca.Function("rates", [X, U], [ca.densify(rates)], {"cse": True}))


def independent_cost(problem: FlightProblem, flown: SimulatedFlight) -> float:
    """Return the cost of a flight, computed by SciPy's DOP853 with the equations of the model.

    The inputs of the flight are interpolated linearly. The linear policy adds a correction for the
    deviation from the states of the flight, so that rounding errors do not grow. The corrected
    inputs are saturated at their limits. The cost of the final state under the linear optimum is
    added.
    """
    trim_x = np.array(problem.point.states)
    trim_u = np.array(problem.point.inputs)
    lowest, highest = problem.input_limits
    moved = problem.moved
    places = problem.places
    rows = np.column_stack([flown.states[:, places], flown.inputs[:, moved]])
    rates = rates_of(problem)
    k = len(places)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        place = np.clip(np.searchsorted(flown.times, t) - 1, 0, len(rows) - 2)
        before, after = flown.times[place : place + 2]
        share = (t - before) / (after - before)
        now = rows[place] + share * (rows[place + 1] - rows[place])
        v = now[k:] - trim_u[moved] - problem.K @ (y[places] - now[:k])
        v = np.clip(v, lowest, highest)
        u = trim_u.copy()
        u[moved] += v
        z = y[places] - trim_x[places]
        price = z @ problem.Q @ z + v @ problem.R @ v
        X, U = rates.inputs
        X[:], U[:] = y[:-1], u
        rates()
        return np.append(rates.results[0], price)

    begin = [*flown.states[0], 0.0]
    seconds = float(flown.times[-1])
    result = solve_ivp(
        rate, (0.0, seconds), begin, "DOP853", rtol=1e-6, atol=1e-8, max_step=seconds / 300.0
    )
    end = result.y[:-1, -1] - trim_x
    return float(result.y[-1, -1] + end[places] @ problem.P @ end[places])


def examined(name: str, source: str, count: int) -> dict[str, Any]:
    """Return the results for one aircraft: best flights from random initial conditions.

    name: name of the aircraft in the results
    source: "published", "newton" or a file of an aircraft
    count: number of initial conditions
    """
    problem = problem_of(source)
    search = BestFlights(problem, count)
    flights: list[dict[str, Any]] = []
    for start in drawn_starts(problem, count, _SEED):
        began = time.process_time()
        try:
            found = search.found(start)
        except NoSolutionError as error:
            seconds = time.process_time() - began
            flights.append({"reason": str(error), "seconds": seconds})
            continue
        seconds = time.process_time() - began
        linear = found.linear
        if found.proposal is None:
            flights.append({"reason": found.reason, "seconds": seconds})
            continue
        flights.append(
            {
                "cost": found.flown.cost,
                "independent": independent_cost(problem, found.flown),
                "proposed": found.proposal.cost,
                "meshes": found.spread_of_meshes,
                "guesses": found.spread_of_guesses,
                "linear_over_best": None if linear.lost else linear.cost / found.flown.cost,
                "seconds": seconds,
            }
        )
        print(f"{name}: {len(flights)} of {count}", file=sys.stderr, flush=True)
    return {"aircraft": name, "source": source, "smooth_copy": has_kinks(problem)} | summary(
        flights
    )


def summary(flights: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the summary of an aircraft's flights: counts, largest errors, median cost ratio and
    times.

    The mean processor time excludes the first flight. The summary also contains all flights.
    """
    found = [each for each in flights if "cost" in each]
    lost = [each["linear_over_best"] is None for each in found]
    ratios = [each["linear_over_best"] for each in found if each["linear_over_best"] is not None]
    return {
        "starts": len(flights),
        "found": len(found),
        "refused": dict(Counter(each["reason"] for each in flights if "reason" in each)),
        "off_independent": max(abs(each["independent"] / each["cost"] - 1.0) for each in found),
        "meshes": max(each["meshes"] for each in found),
        "guesses": max(each["guesses"] for each in found),
        "linear_lost": sum(lost),
        "linear_over_best": float(np.median(ratios)) if ratios else None,
        "seconds": float(np.mean([each["seconds"] for each in flights[1:]])),
        "flights": list(flights),
    }


def table(rows: Sequence[dict[str, Any]]) -> Table:
    """Return a table with one row for each aircraft."""
    lines = []
    for row in rows:
        ratio = row["linear_over_best"]
        lines.append(
            (
                row["aircraft"],
                f"{row['found']} of {row['starts']}",
                f"{100 * row['off_independent']:.2g} %",
                f"{100 * row['meshes']:.2g} %",
                f"{100 * row['guesses']:.2g} %",
                f"{row['linear_lost']}",
                "-" if ratio is None else f"{ratio:.4g}",
                f"{row['seconds']:.2g} s",
            )
        )
    header = (
        *("aircraft", "found", "SciPy differs", "meshes", "guesses"),
        *("linear optimum leaves limits", "median cost over best", "one flight"),
    )
    return Table(header, lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, write its file, print the table and return 0."""
    parser = argparse.ArgumentParser(
        "python -m studies.best_flights.examination", description=__doc__
    )
    parser.add_argument("--aircraft", action="append", choices=list(AIRCRAFT), metavar="NAME")
    parser.add_argument("--starts", type=int, default=_STARTS, metavar="N")
    parser.add_argument(
        "-o",
        type=Path,
        default=Path("out/best_flights"),
        metavar="FOLDER",
        help="default: %(default)s",
    )
    options = parser.parse_args(argv)
    path = options.o / "examination.json"

    def row_of(name: str) -> dict[str, Any]:
        return examined(name, AIRCRAFT[name], options.starts)

    decides = {"seed": _SEED, "starts": options.starts}
    rows = row_by_row(path, AIRCRAFT, options.aircraft, decides, row_of)
    print(Report("Best flights from seeded starts", (table(rows),)).text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
