"""Flights from the paper's x(0), as stored in studies/best_flights/results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_model import choice
from hfa_support.errors import BadInputError, file_faults
from hfa_support.files import read_json
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Cell, Table, beside_unit

#: (dihedral angle in deg, A, B) of linear models.
Models = list[tuple[float, np.ndarray, np.ndarray]]
#: Relative and absolute tolerance for equal entries of linear models: their trims balance to 1e-10
#: on every machine.
_ENTRY_TOLERANCE = 1e-9
#: Schema of best_flights.json.
SCHEMA = "hfa.paper-flights/2"
_STORED_IN = "studies/best_flights/results"
_TITLE = "Costs of nonlinear flights from the paper's x(0)"
#: Column of the table -> key in the file.
_POLICIES = {
    "exact game policy": "exact_policy",
    "exact LQR": "exact_lqr",
    "learned critic": "learned_critic",
    "predictive policy": "predictive",
}


class StoredFlights(NamedTuple):
    """Content of best_flights.json.

    data: the complete content
    table: costs of the flights
    limits: the assumed limits in words
    models: (dihedral angle in deg, A, B) of the linear model at each trim
    """

    data: dict[str, Any]
    table: Table
    limits: str
    models: Models


def flights_section(
    flights: StoredFlights, A_and_B: Mapping[float, tuple[np.ndarray, np.ndarray]]
) -> Report:
    """Return the section of the page on stored flights.

    The section contains the costs, the assumed limits, and whether the flights used this page's
    aircraft.

    A_and_B: dihedral angle, deg -> (A, B) on this page
    """
    same = (
        "this page's aircraft"
        if _are_same_models(flights.models, A_and_B)
        else "ANOTHER aircraft than this page's"
    )
    about = (
        "Costs are integrals of x'Qx + u'Ru with the paper's Q and R. The first three policies are "
        "linear, and their inputs are saturated. The predictive policy plans on the nonlinear "
        "model. Left: the flight leaves the limits at this time. "
        f"{flights.limits} "
        f"Stored results, computed for {same}."
    )
    return Report(_TITLE, (flights.table, about), data=flights.data)


def load_flights(path: str) -> StoredFlights:
    """Return the content of best_flights.json.

    path: the file, or the folder that contains it

    Raises BadInputError if the file cannot be read, has another schema or lacks an entry.
    """
    file = Path(path)
    if file.is_dir():
        file = file / "best_flights.json"
    with file_faults(file):
        data = read_json(file)
    try:
        if data["schema"] != SCHEMA:
            raise ValueError(data["schema"])
        return _flights(data)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise BadInputError(
            f"{file}: an entry is missing or wrong ({error!r}); take the file of {_STORED_IN}"
        ) from error


def _flights(data: dict[str, Any]) -> StoredFlights:
    """Return the flights in the data of a file."""
    models = [
        (float(model["dihedral_deg"]), np.array(model["A"]), np.array(model["B"]))
        for model in data["models"]
    ]
    limits = limits_in_words(data["limits"])
    return StoredFlights(data, flights_table(data["flights"]), limits, models)


def _are_same_models(
    models: Models, A_and_B: Mapping[float, tuple[np.ndarray, np.ndarray]]
) -> bool:
    """Return whether linear models equal (A, B) at all angles that both have. The result is False
    if they have no angle in common.
    """
    shared = [model for model in models if model[0] in A_and_B]
    return bool(shared) and all(
        stored.shape == other.shape
        and np.allclose(stored, other, rtol=_ENTRY_TOLERANCE, atol=_ENTRY_TOLERANCE)
        for degrees, *pair in shared
        for stored, other in zip(pair, A_and_B[degrees], strict=True)
    )


def flights_table(flights: Sequence[Mapping[str, Any]]) -> Table:
    """Return a table of stored flights with one row for each angle and set of limits.

    A row contains the cost of each policy's flight, also divided by the cost of the best flight,
    and the cost of the best flight.
    """
    header = ("dihedral, assumed limits", *_POLICIES, "best flight found")
    rows = [
        (
            f"{flight['dihedral_deg']:g} deg, {flight['within']}",
            *(_cost_cell(flight[key]) for key in _POLICIES.values()),
            Cell(f"{flight['best']['cost']:,.0f}"),
        )
        for flight in flights
    ]
    return Table(header, rows)


def _cost_cell(flight: Mapping[str, Any]) -> Cell:
    """Return the cost of a policy's flight, the ratio of this cost to that of the best flight, and
    the time at which the flight leaves the limits.
    """
    if flight["cost"] is None:  # the flight has not ended at the trim
        return Cell("not at the trim" if flight["departure"] is None else _left(flight))
    cost = f"{flight['cost']:,.0f} ({flight['over_best']:.3g}x)"
    return Cell(cost if flight["departure"] is None else f"{cost}, {_left(flight)}")


def _left(flight: Mapping[str, Any]) -> str:
    """Return the time at which a flight leaves the limits, in words."""
    return f"left, {flight['departure']['time']:.2g} s"


def limits_in_words(limits: Mapping[str, Mapping[str, Sequence[float]]]) -> str:
    """Return a sentence that lists each set of assumed limits.

    The first set is listed completely. Of every further set, only the limits that differ from the
    first set are listed.

    limits: name of the set -> state or input -> (lowest, highest)
    """
    sentences = []
    first: Mapping[str, Sequence[float]] = {}
    for name, pairs in limits.items():
        changed = {key: pair for key, pair in pairs.items() if pair != first.get(key)}
        listed = ", ".join(_limit(key, *pair) for key, pair in changed.items())
        sentences.append(f"{name}: {listed}.")
        first = first or pairs
    return f"Assumed limits (the paper prints none): {' '.join(sentences)}"


def _limit(name: str, lowest: float, highest: float) -> str:
    """Return the limits of a state or input of the paper's aircraft as text."""
    from hfa_flight.simulate.envelope import limits_text

    unit = choice.aircraft().unit(name)
    return beside_unit(f"{name} {limits_text(lowest, highest, unit)}", unit)
