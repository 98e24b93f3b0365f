"""Proved lower bounds on the cost for five aircraft, compared with simulated flights.

The bounds are compared with the best flights found from random initial conditions, and with many
flights of other control laws. The study takes a quarter of an hour. It writes FOLDER/bounds.json
after each aircraft, and an interrupted run can be continued.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import hfa
from hfa_flight.initial_box import drawn_starts
from hfa_flight.problem import flight_problem
from hfa_optimal.initial_conditions import starts_table
from hfa_optimal.search import BestFlights
from hfa_prove.search.cost import bound_search
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from studies.bounds.aircraft import VAN_DER_POL, navion_of_the_tutorial
from studies.bounds.flights import cost_ratios
from studies.finished import row_by_row

_SEED = 0


class Bounded(NamedTuple):
    """An aircraft of the study.

    model: function that returns the aircraft
    degree: degree of the bound W, a polynomial
    margin: relative distance of W below the linear quadratic cost
    flights: number of flights compared with the bound
    """

    model: Callable[[], hfa.Model]
    degree: int
    margin: float
    flights: int


AIRCRAFT = {
    "van der Pol": Bounded(lambda: VAN_DER_POL, 8, 0.02, 40_000),
    "pendulum": Bounded(partial(hfa.load_model, "examples/pendulum.py:PENDULUM"), 12, 0.02, 40_000),
    "F-16": Bounded(partial(hfa.load_model, "examples/f16_constant.py:F16"), 4, 0.05, 15_000),
    "Navion": Bounded(navion_of_the_tutorial, 4, 0.02, 15_000),
    "GTM": Bounded(partial(hfa.load_model, "examples/gtm.py:GTM"), 4, 0.02, 15_000),
}


def bounded(name: str, starts: int, flights: int | None = None) -> dict[str, Any]:
    """Return the results for one aircraft: a proved lower bound, compared with flights.

    name: name of the aircraft in `AIRCRAFT`
    starts: number of initial conditions of best flights
    flights: number of other flights, or None for the default of the aircraft
    """
    aircraft = AIRCRAFT[name]
    model = aircraft.model()
    problem = flight_problem(model, hfa.trim(model))
    search = bound_search(problem, degree=aircraft.degree, margin=aircraft.margin, seconds=120.0)
    begin = time.process_time()
    found = search.found()
    seconds = time.process_time() - begin
    bound = found.statement
    best = BestFlights(problem, starts)
    table = starts_table(best, drawn_starts(problem, starts, _SEED), bound=bound)
    ratios = [1.0 / ratio for ratio in table.over_bound]
    other = cost_ratios(problem, bound, flights or aircraft.flights, _SEED)
    return {
        "aircraft": name,
        "degree": aircraft.degree,
        "margin": aircraft.margin,
        "boxes": list(found.boxes),
        "seconds": seconds,
        "starts": len(ratios),
        "bound_over_best": {"least": min(ratios), "median": float(np.median(ratios))},
        "flights": other._asdict(),
    }


def table_of(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table with one row for each aircraft."""
    lines = []
    for row in rows:
        over_best, other = row["bound_over_best"], row["flights"]
        lines.append(
            (
                row["aircraft"],
                f"{row['degree']}, {row['margin']:g}",
                f"{max(row['boxes']):,}",
                f"{over_best['least']:.3f}, {over_best['median']:.3f}",
                f"{row['seconds']:.0f} s",
                f"{other['flights']:,}",
                f"{other['below']}",
                f"{other['least']:.4f}",
            )
        )
    header = (
        *("aircraft", "degree, margin", "boxes of the largest set", "least, median ratio"),
        *("processor time", "flights", "below the bound", "least over it"),
    )
    return Table(header, lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, write its file and print the table.

    Return 1 if a flight costs less than the bound, otherwise 0.
    """
    parser = argparse.ArgumentParser("python -m studies.bounds", description=__doc__)
    parser.add_argument("--aircraft", action="append", choices=list(AIRCRAFT), metavar="NAME")
    parser.add_argument("--starts", type=int, default=30, metavar="N")
    parser.add_argument("--flights", type=int, metavar="N")
    parser.add_argument(
        "-o", type=Path, default=Path("out/bounds"), metavar="FOLDER", help="default: %(default)s"
    )
    options = parser.parse_args(argv)
    row_of = partial(bounded, starts=options.starts, flights=options.flights)
    decides = {"seed": _SEED, "starts": options.starts, "flights": options.flights}
    rows = row_by_row(options.o / "bounds.json", AIRCRAFT, options.aircraft, decides, row_of)
    print(Report("Lower bounds of the cost, proved", (table_of(rows),)).text())
    return int(any(row["flights"]["below"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
