"""Results in memory as xarray datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_stores.sweep_arrays import ARRAYS, labels_of
from hfa_support.errors import BadInputError
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint
from trim.sweeps.sweep import Sweep

if TYPE_CHECKING:
    import xarray


def dataset(result: Any) -> xarray.Dataset:
    """Return a result as an `xarray.Dataset` with names and units.

    result: operating point, linear model or sweep

    Raises BadInputError if xarray is missing, or for any other type of result.
    """
    try:
        import xarray  # noqa: F401
    except ImportError:
        raise BadInputError("xarray is not installed; type python -m pip install xarray") from None
    if isinstance(result, Sweep):
        return _of_sweep(result)
    if isinstance(result, LinearModel):
        return _of_linear(result)
    if isinstance(result, OperatingPoint):
        return _of_point(result)
    raise BadInputError(
        f"a {type(result).__name__} cannot be converted to a dataset; use to_pandas() or to_dict()"
    )


def _of_point(point: OperatingPoint) -> xarray.Dataset:
    """Return the dataset of an operating point: each state, input and output with its unit."""
    import xarray

    values = {
        name: ((), value, {"units": point.model.unit(name)}) for name, value in dict(point).items()
    }
    return xarray.Dataset(values, attrs={"model": point.model.title})


def _of_linear(model: LinearModel) -> xarray.Dataset:
    """Return the dataset of a linear model: A, B, C, D and the offsets X0, U0 and Y0."""
    import xarray

    states = ("state", list(model.states), {"units": list(model.state_units)})
    inputs = ("input", list(model.inputs), {"units": list(model.input_units)})
    outputs = ("output", list(model.outputs), {"units": list(model.output_units)})
    return xarray.Dataset(
        {
            "A": (("rate", "state"), model.A),
            "B": (("rate", "input"), model.B),
            "C": (("output", "state"), model.C),
            "D": (("output", "input"), model.D),
            "X0": ("state", model.state_offsets),
            "U0": ("input", model.input_offsets),
            "Y0": ("output", model.output_offsets),
        },
        coords={
            "state": states,
            "input": inputs,
            "output": outputs,
            "rate": ("rate", list(model.states)),
        },
        attrs={"model": model.model.title},
    )


def _of_sweep(swept: Sweep) -> xarray.Dataset:
    """Return the dataset of a sweep: states, inputs, A, B, eigenvalues and reasons.

    The axes are those of the grid, or "point" for a list.
    """
    import xarray

    plan = swept.plan
    axes: tuple[str, ...] = ("point",)
    if plan.listed:
        coordinates = {name: ("point", swept.values[:, i]) for i, name in enumerate(plan.axes)}
    else:
        axes = plan.variables
        coordinates = {name: (name, np.array(plan.axes[name])) for name in plan.axes}
    dataset = xarray.Dataset(
        coords={
            **coordinates,
            **labels_of(swept.model, rates=swept.model.linear),
            "linear_state": list(swept.model.linear),
        },
        attrs={"model": swept.model.title},
    )
    if swept.mode_names:
        dataset.coords["mode"] = list(swept.mode_names)
    dataset["reason"] = (axes, np.array(swept.reasons).reshape(plan.sizes))
    for name, array in ARRAYS.items():
        values = getattr(swept, name)
        own_axes = ("rate", "linear_state") if name == "A" else array.axes
        reshaped = values.reshape(*plan.sizes, *values.shape[1:])
        dataset[name] = ((*axes, *own_axes), reshaped, array.attributes)
    for name, unit in zip(plan.variables, plan.units, strict=True):
        dataset[name].attrs["units"] = unit
    return dataset
