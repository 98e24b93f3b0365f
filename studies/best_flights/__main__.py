"""Cost of flights of the nonlinear HFA from the paper's x(0) at 5, 10 and 15 deg.

The study compares the best flight found with the exact game policy, the exact LQR, a learned critic
and the predictive policy, within two sets of limits. The study takes half a minute. It writes
FOLDER/best_flights.json, which `hfa report --flights` reads, and FOLDER/best_flights.png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import hfa
from hfa.page.flights import SCHEMA, flights_table, limits_in_words
from hfa_flight.problem import FlightProblem, flight_problem
from hfa_optimal.best_flight import BestFlight
from hfa_optimal.predictive import policy_of
from hfa_optimal.search import AFTER, BestFlights
from hfa_support.files import write_text
from hfa_support.reporting.data_files import json_text, jsonable
from hfa_support.reporting.figure import new_figure, save
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import shown_unit, shown_values
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEGREES = (5.0, 10.0, 15.0)
#: x(0) of Section 5: deviations from the trim, ft/s and rad.
START = {"speed": 5.0, "alpha": 0.05}
_FAST = float(np.radians(600.0))
#: Set of limits -> limits that replace those of the flight envelope.
LIMITS: dict[str, dict[str, tuple[float, float]]] = {
    "flight envelope": {},
    "rates of 600 deg/s": {
        "pitch_rate": (-_FAST, _FAST),
        "dihedral_rate": (-_FAST, _FAST),
    },
}
#: Drawn duration in s, and drawn signals.
_SECONDS = 2.5
_DRAWN = ("speed", "alpha", "pitch_rate", "elevator_center")


def best_flight_and_policies(
    linear: LinearModel, limits: dict[str, tuple[float, float]]
) -> BestFlight:
    """Return the best flight found from the paper's x(0), together with flights of four policies.

    The policies are the exact LQR, a critic learned as by `hfa learn`, the exact game policy and
    the predictive policy.

    linear: linear model at the trim
    limits: name of a state -> (lowest, highest)
    """
    game = hfa.paper.published_game(linear)
    problem = flight_problem(linear.point.model, linear.point, game.Q, game.R, limits=limits)
    search = BestFlights(problem)
    start = problem.deviations(START)
    found = search.found(start)
    gains = {
        "learned critic, saturated": hfa.learn(game, seed=0).K,
        "exact game policy, saturated": hfa.solve(game).K,
    }
    flights = search.flights
    loops = [flights.of_gain(name, K) for name, K in gains.items()]
    loops.append(flights.of_policy(policy_of(problem, game)))
    seconds = (1.0 + AFTER) * found.seconds
    flown = [flights.fly(loop, start, seconds) for loop in loops]
    return BestFlight(problem, found, tuple(flown))


def flight_data(degrees: float, name: str, best: BestFlight) -> dict[str, Any]:
    """Return the data stored for the flights at one dihedral angle within one set of limits.

    degrees: dihedral angle
    name: name of the set of limits
    best: the best flight and the flights of the policies
    """
    linear, learned, exact, predictive = best.policies
    return {
        "dihedral_deg": degrees,
        "within": name,
        "best": {
            "cost": best.cost,
            "proposed_cost": best.proposed_cost,
            "spread": best.spread,
            "saturated": best.saturated,
        },
        "exact_policy": exact.as_data(),
        "exact_lqr": linear.as_data(),
        "learned_critic": learned.as_data(),
        "predictive": predictive.as_data(),
    }


def limits_of(problem: FlightProblem) -> dict[str, list[float]]:
    """Return [lowest, highest] of each state in the envelope and of each moving input, by name."""
    envelope = problem.envelope
    pairs = zip(envelope.lowest.tolist(), envelope.highest.tolist(), strict=True)
    limits = {name: list(pair) for name, pair in zip(envelope.names, pairs, strict=True)}
    for name in problem.inputs:
        signal = problem.model.inputs[name]
        limits[name] = [signal.min, signal.max]
    return limits


def study() -> tuple[dict[str, Any], list[BestFlight]]:
    """Return the data to store and the flights, for all dihedral angles and sets of limits."""
    aircraft = hfa.aircraft()
    models = [hfa.paper.level_model(aircraft, np.radians(degrees)) for degrees in DEGREES]
    flown = []
    rows = []
    within = {}
    for name, limits in LIMITS.items():
        for degrees, linear in zip(DEGREES, models, strict=True):
            best = best_flight_and_policies(linear, limits)
            flown.append(best)
            rows.append(flight_data(degrees, name, best))
        within[name] = limits_of(best.problem)
    stored = [
        {"dihedral_deg": degrees, "A": linear.A, "B": linear.B}
        for degrees, linear in zip(DEGREES, models, strict=True)
    ]
    data = {
        "schema": SCHEMA,
        "start": START,
        "limits": within,
        "models": stored,
        "flights": rows,
    }
    return jsonable(data), flown


def drawn(flights: Sequence[BestFlight]) -> Figure:
    """Return a figure with a column of panels for each dihedral angle.

    Each panel shows one signal of the best flight found, of the exact game policy and of the
    predictive policy.
    """
    figure = new_figure(10.0, 7.0)
    panels = figure.subplots(len(_DRAWN), len(flights), sharex=True, sharey="row", squeeze=False)
    for column, (degrees, best) in enumerate(zip(DEGREES, flights, strict=True)):
        panels[0, column].set_title(f"dihedral {degrees:g} deg, lowest cost {best.cost:,.0f}")
        for name, axes in zip(_DRAWN, panels[:, column], strict=True):
            _draw(axes, best, name)
        panels[-1, column].set_xlabel("time, s")
    for name, axes in zip(_DRAWN, panels[:, 0], strict=True):
        axes.set_ylabel(f"{name}, {shown_unit(flights[0].model.unit(name))}")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _draw(axes: Axes, best: BestFlight, name: str) -> None:
    """Draw a signal of the best flight, of the exact policy and of the predictive policy, with its
    limits.
    """
    unit = best.model.unit(name)
    limits = shown_values(np.array(limits_of(best.problem)[name]), unit)
    names = [*best.state_names, *best.input_names]
    of_best = np.column_stack([best.states, best.inputs])[:, names.index(name)]
    axes.plot(best.time, shown_values(of_best, unit), label="best flight found")
    for flown, style in zip(best.compared[-2:], ("--", "-."), strict=True):
        rows = flown.times <= _SECONDS
        values = np.column_stack([flown.states, flown.inputs])[rows, names.index(name)]
        axes.plot(flown.times[rows], shown_values(values, unit), style, label=flown.name)
    axes.axhline(float(limits[0]), color="black", linestyle=":", linewidth=0.8, label="limits")
    axes.axhline(float(limits[1]), color="black", linestyle=":", linewidth=0.8)
    room = 0.1 * (limits[1] - limits[0])
    axes.set_ylim(limits[0] - room, limits[1] + room)
    axes.set_xlim(0.0, _SECONDS)
    axes.grid(alpha=0.3)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, write its files, print the table and return 0."""
    parser = argparse.ArgumentParser("python -m studies.best_flights", description=__doc__)
    parser.add_argument(
        "-o",
        type=Path,
        default=Path("out/best_flights"),
        metavar="FOLDER",
        help="default: %(default)s",
    )
    folder = parser.parse_args(argv).o
    data, flown = study()
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "best_flights.json", json_text(data))
    save(drawn(flown[: len(DEGREES)]), folder / "best_flights.png")
    parts = (flights_table(data["flights"]), limits_in_words(data["limits"]))
    print(Report("Flights of the nonlinear HFA from the paper's x(0)", parts).text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
