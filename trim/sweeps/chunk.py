"""One chunk of a large sweep: values in, stacked arrays out. What a worker runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.parameters import Parameters
from hfa_model.variants import variant_named
from hfa_model.vectors import INPUTS, STATES
from trim.point.condition import LIMITS
from trim.sweeps.level_flights import solve_level_flights
from trim.sweeps.sweep import level_conditions, settle

#: What became of a point.
STATUS = ("trimmed", "beyond limits", "no trim")
TRIMMED, BEYOND_LIMITS, NO_TRIM = range(len(STATUS))


class Chunk(NamedTuple):
    """N points. status: (N,) index into `STATUS`. limiting: (N,) index into STATES + INPUTS of the variable
    farthest beyond its limits, -1 when none. states: (N, 7), inputs: (N, 5): where trimmed, or what balance
    would take where beyond limits. A: (N, 7, 7), B: (N, 7, 5), eigenvalues: (N, 7) of A, fastest first; nan
    where not trimmed. Units: rad, ft, s as in `vectors.py`, entries of A and B as in `entry_unit`, eigenvalues 1/s.
    """

    status: np.ndarray
    limiting: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    eigenvalues: np.ndarray


def run_chunk(
    variables: tuple[str, ...],
    values: np.ndarray,
    parameters: Parameters,
    dynamics: str,
    compile_code: bool | None = None,
) -> Chunk:
    """Trim and linearize every row of `values`; a row without a trim keeps its status instead of raising.

    compile_code: see `solve_level_flights`.
    """
    variant = variant_named(dynamics)
    conditions, constants = level_conditions(variables, values), _constants(variables, values, parameters)
    flights = solve_level_flights(variant, constants, conditions, compile_code=compile_code)
    beyond = _excess(flights.states, flights.inputs)
    status = np.where(flights.trimmed, TRIMMED, np.where(flights.balanced, BEYOND_LIMITS, NO_TRIM)).astype(np.int8)
    for index in np.flatnonzero(status == NO_TRIM):
        # The batch's Newton did not converge: the robust solver has the last word.
        aircraft = Aircraft(Parameters(*constants[index].tolist()), variant)
        if settle(aircraft, conditions[index], flights, int(index)):
            flights.states[index], flights.inputs[index] = np.nan, np.nan
        else:
            status[index] = TRIMMED
    good = status == TRIMMED
    flights.A[~good], flights.B[~good] = np.nan, np.nan
    eigenvalues = np.full((len(values), len(STATES)), np.nan, dtype=complex)
    eigenvalues[good] = np.linalg.eigvals(flights.A[good])
    order = np.lexsort((-eigenvalues.imag, -np.round(np.abs(eigenvalues), 9)))
    return Chunk(
        status=status,
        limiting=np.where(status == BEYOND_LIMITS, beyond, -1).astype(np.int8),
        states=flights.states,
        inputs=flights.inputs,
        A=flights.A,
        B=flights.B,
        eigenvalues=np.take_along_axis(eigenvalues, order, axis=1),
    )


def _constants(variables: tuple[str, ...], values: np.ndarray, parameters: Parameters) -> np.ndarray:
    """Parameters (N, 18)."""
    constants = np.tile(np.array(parameters, dtype=float), (len(values), 1))
    for column, name in enumerate(variables):
        if name in Parameters._fields:
            constants[:, Parameters._fields.index(name)] = values[:, column]
    return constants


def _excess(states: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    """(N,) index of the variable farthest beyond its limits, in units of the limits' width."""
    values = np.hstack([states, inputs])
    limits = np.array([LIMITS[name] for name in STATES + INPUTS])
    width = np.where(np.isfinite(limits).all(axis=1), limits[:, 1] - limits[:, 0], 1.0)
    with np.errstate(invalid="ignore"):
        beyond = np.maximum(limits[:, 0] - values, values - limits[:, 1]) / width
    return np.asarray(np.nan_to_num(beyond, nan=-np.inf).argmax(axis=1))
