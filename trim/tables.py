"""Datasets and pyplot curves of named values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import imported
from hfa_support.files import written_whole
from hfa_support.reporting.figure import pyplot_figure
from hfa_support.reporting.text import beside_unit, shown_values

if TYPE_CHECKING:
    import xarray


def dataset(
    variables: Mapping[str, Any], coordinates: Mapping[str, Any], title: str
) -> xarray.Dataset:
    """Return an `xarray.Dataset` with the attribute `model`.

    variables, coordinates: name -> (axes, values) or (axes, values, attributes)
    title: title of the model

    Raises BadInputError if xarray is missing.
    """
    xarray = imported("xarray", "labelled arrays require")
    return xarray.Dataset(variables, coordinates, {"model": title})


def entry_headings(
    model: Model, matrix: str, rows: Sequence[str], columns: Sequence[str]
) -> list[str]:
    """Return a heading of each entry of A to F, row by row: "A(pitch, alpha) [(rad/s)/(rad)]"."""
    unit_of_row = model.unit if matrix in "CDF" else model.rate_unit
    return [
        f"{matrix}({row}, {column}) [({unit_of_row(row)})/({model.unit(column)})]"
        for row in rows
        for column in columns
    ]


def eigenvalue_headings(mode: str, time: str) -> list[str]:
    """Return the headings of the parts of an eigenvalue: "phugoid eigenvalue real [1/s]"."""
    return [f"{mode} eigenvalue {part} [1/{time}]" for part in ("real", "imaginary")]


def write_netcdf(labelled: xarray.Dataset, path: str | Path) -> None:
    """Write a dataset as a NetCDF file (version 3), completely or not at all.

    NetCDF has no complex numbers: `NAME` is written as `NAME_real` and `NAME_imag`.
    """
    is_complex = [name for name, variable in labelled.items() if np.iscomplexobj(variable)]
    parts = {
        f"{name}_{part}": getattr(labelled[name], part)
        for name in is_complex
        for part in ("real", "imag")
    }
    with written_whole(path) as stream:
        stream.write(labelled.drop_vars(is_complex).assign(parts).to_netcdf(engine="scipy"))


def draw_curves(
    model: Model,
    across: tuple[str, str, np.ndarray],
    series: Mapping[str, np.ndarray],
    lines: Sequence[slice],
) -> np.ndarray:
    """Draw named values in a new pyplot figure, one panel each, and return the Axes.

    model: model with the units of the names; a name that it does not declare has the unit 1
    across: name, unit and values (N,) of the horizontal axis
    series: name -> values (N,)
    lines: slices of the N values, each drawn as a line
    """
    x, x_unit, x_values = across
    shown_x = shown_values(x_values, x_unit)
    axes = pyplot_figure(8.0, 1.0 + 2.0 * len(series)).subplots(len(series), sharex=True)
    for panel, (name, values) in zip(np.ravel(axes), series.items(), strict=True):
        unit = model.unit(name) if name in model.signals else "1"
        shown = shown_values(values, unit)
        for line in lines:
            panel.plot(shown_x[line], shown[line])
        panel.set_ylabel(beside_unit(name, unit, ", "))
        panel.grid(alpha=0.3)
    panel.set_xlabel(beside_unit(x, x_unit, ", "))
    return np.ravel(axes)
