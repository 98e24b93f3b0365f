"""Trims and linear models of many points, those without a trim kept: what sweeps in memory and in a store run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import Parameters
from hfa_model.variants import Variant, variant_named
from hfa_model.vectors import INPUTS, STATES
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress
from trim.linear.linear_model import linearize
from trim.point.condition import LIMITS, VARIABLES, TrimCondition
from trim.point.named_condition import LEVEL_FLIGHT, NamedCondition
from trim.point.operating_point import OperatingPoint, Status
from trim.point.solve import find_operating_point
from trim.sweeps.level_flights import LevelFlights, are_level_flights, level_conditions, solve_level_flights, unsolved

#: What became of a point.
STATUS = (Status.TRIMMED, Status.BEYOND_LIMITS, Status.NO_TRIM)
TRIMMED, BEYOND_LIMITS, NO_TRIM = range(len(STATUS))


class Chunk(NamedTuple):
    """N points. status: (N,) index into `STATUS`. limiting: (N,) index into STATES + INPUTS of the variable
    farthest beyond its limits, -1 when none. states: (N, 7), inputs: (N, 5): where trimmed, or what balance
    would take where beyond limits. A: (N, 7, 7), B: (N, 7, 5); nan where not trimmed. failures: number of a point
    with no trim -> why. Units: rad, ft, s as in `vectors.py`, entries of A and B as in `entry_unit`.
    """

    status: np.ndarray
    limiting: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    failures: dict[int, str]


def run_chunk(
    variables: tuple[str, ...],
    values: np.ndarray,
    parameters: Parameters,
    dynamics: str | Variant,
    compile_code: bool | None = None,
    condition: NamedCondition = LEVEL_FLIGHT,
    start: OperatingPoint | None = None,
    progress: Progress | None = None,
) -> Chunk:
    """Trim and linearize every row of `values`; a row without a trim keeps its status instead of raising.

    compile_code: see `solve_level_flights`. condition: what is imposed beside the values. start: where the search of
    `find_operating_point` begins at each point. progress is called with (points settled, points in all).

    What is no level flight goes point by point through `find_operating_point`, which does not tell beyond limits from
    no trim.
    """
    variant = variant_named(dynamics) if isinstance(dynamics, str) else dynamics
    constants = _constants(variables, values, parameters)
    if are_level_flights(variables, condition):
        conditions = level_conditions(variables, values, condition)
        flights = solve_level_flights(
            variant, constants, conditions, limits=condition.limits, compile_code=compile_code
        )
    else:
        flights = unsolved(len(values))
    status = np.where(flights.trimmed, TRIMMED, np.where(flights.balanced, BEYOND_LIMITS, NO_TRIM)).astype(np.int8)
    failures: dict[int, str] = {}
    settled = int(np.count_nonzero(flights.trimmed))
    for done, index in enumerate(np.flatnonzero(status == NO_TRIM).tolist(), start=settled + 1):
        aircraft = Aircraft(Parameters(*constants[index].tolist()), variant)
        reason = _settle(aircraft, partial(condition_at, condition, variables, values[index]), start, flights, index)
        if reason:
            failures[index] = reason
            flights.states[index], flights.inputs[index] = np.nan, np.nan
        else:
            status[index] = TRIMMED
        if progress is not None:
            progress(done, len(values))
    limiting = np.full(len(values), -1, dtype=np.int8)
    beyond = status == BEYOND_LIMITS
    limiting[beyond] = _farthest(flights.states[beyond], flights.inputs[beyond], {**LIMITS, **condition.limits})
    flights.A[status != TRIMMED], flights.B[status != TRIMMED] = np.nan, np.nan
    return Chunk(status, limiting, flights.states, flights.inputs, flights.A, flights.B, failures)


def condition_at(condition: NamedCondition, variables: tuple[str, ...], row: np.ndarray) -> TrimCondition:
    """The condition of one point; BadInputError where one of its values lies outside its limits."""
    hold = {name: value for name, value in zip(variables, row.tolist(), strict=True) if name in VARIABLES}
    return condition.at(hold.get("dihedral", 0.0), hold)


def _settle(
    aircraft: Aircraft,
    condition: Callable[[], TrimCondition],
    start: OperatingPoint | None,
    flights: LevelFlights,
    index: int,
) -> str:
    """The robust solver's word on a point that the batch's Newton could not balance.

    "" and the point with its A and B written into `flights`, or why there is no trim.
    """
    try:
        point = find_operating_point(aircraft, condition(), start)
    except (BadInputError, NoSolutionError) as error:
        return str(error)
    model = linearize(aircraft, point, full=True)
    flights.states[index], flights.inputs[index] = point.states, point.inputs
    flights.A[index], flights.B[index] = model.A, model.B
    return ""


def _constants(variables: tuple[str, ...], values: np.ndarray, parameters: Parameters) -> np.ndarray:
    """Parameters (N, 18)."""
    constants = np.tile(np.array(parameters, dtype=float), (len(values), 1))
    for column, name in enumerate(variables):
        if name in Parameters._fields:
            constants[:, Parameters._fields.index(name)] = values[:, column]
    return constants


def _farthest(states: np.ndarray, inputs: np.ndarray, allowed: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """(N,) index of the variable farthest beyond its limits, in units of the limits' width."""
    values = np.hstack([states, inputs])
    limits = np.array([allowed[name] for name in STATES + INPUTS])
    width = np.where(np.isfinite(limits).all(axis=1), limits[:, 1] - limits[:, 0], 1.0)
    return np.asarray((np.maximum(limits[:, 0] - values, values - limits[:, 1]) / width).argmax(axis=1))
