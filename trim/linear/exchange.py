"""A linear model as the object of another package."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import control
    import xarray

    from trim.linear.linear_model import LinearModel


def state_space(model: LinearModel) -> control.StateSpace:
    """Return python-control's StateSpace, with names."""
    import control

    return control.ss(
        model.A,
        model.B,
        model.C,
        model.D,
        states=list(model.states),
        inputs=list(model.inputs),
        outputs=list(model.outputs),
    )


def dataset(model: LinearModel) -> xarray.Dataset:
    """Return an xarray Dataset with A, B, C, D and the offsets X0, U0 and Y0, with names and
    units."""
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
        attrs={"model": model.point.model.title},
    )
