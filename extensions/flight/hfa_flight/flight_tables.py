"""Conversion of a flight to NumPy arrays, pandas tables and xarray datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_support.errors import refuse_unknown

if TYPE_CHECKING:
    import pandas
    import xarray

    from hfa_flight.nonlinear_flight import Flight


def series(flight: Any, name: str, p: np.ndarray) -> np.ndarray:
    """Return the absolute values, (N,), of a state, an input or an output of the model.

    flight: `Flight`, or another object with `model`, `states` and `inputs`
    p: parameters of the simulated model

    Raises BadInputError if the name is unknown.
    """
    model = flight.model
    refuse_unknown("unknown variable", name, (*model.states, *model.inputs, *model.outputs))
    if name in model.states:
        return np.asarray(flight.states[:, list(model.states).index(name)])
    if name in model.inputs:
        return np.asarray(flight.inputs[:, list(model.inputs).index(name)])
    count = len(flight.states)
    parameters = np.tile(p[:, None], (1, count))
    function = model.functions((name,)).map(count)
    return np.array(function(flight.states.T, flight.inputs.T, parameters)[1]).ravel()


def frame(flight: Flight) -> pandas.DataFrame:
    """Return a pandas table of the absolute states and inputs, indexed by time in s."""
    import pandas

    columns = [*flight.model.states, *flight.model.inputs]
    index = pandas.Index(flight.time, name="time")
    return pandas.DataFrame(np.hstack([flight.states, flight.inputs]), index, columns)


def dataset(flight: Flight) -> xarray.Dataset:
    """Return an xarray Dataset of the absolute states and inputs over time, with units.

    A linear prediction is included as NAME_linear for each state.
    """
    import xarray

    model = flight.model
    values = dict(zip(model.states, flight.states.T, strict=True))
    values |= dict(zip(model.inputs, flight.inputs.T, strict=True))
    variables = {
        name: ("time", column, {"units": model.unit(name)}) for name, column in values.items()
    }
    if flight.predicted is not None:
        predicted = flight.predicted.states + np.array(flight.point.states)
        for name, column in zip(model.states, predicted.T, strict=True):
            variables[f"{name}_linear"] = ("time", column, {"units": model.unit(name)})
    time = ("time", flight.time, {"units": model.time_unit})
    return xarray.Dataset(variables, {"time": time}, {"model": model.title})
