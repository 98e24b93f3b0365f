"""Conversion of a linear model to objects of other packages."""

from __future__ import annotations

from inspect import isfunction
from typing import TYPE_CHECKING, Any

from hfa_support.errors import no_attribute
from trim.linear.responses import Names, chosen

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


def of_control(model: LinearModel, name: str) -> Any:
    """Return an attribute of python-control's StateSpace, or a function of python-control on the
    model.

    Names of python-control's MATLAB interface are accepted too. The function acts from the inputs=
    to the outputs= of its call. Raises AttributeError for another name.
    """
    import control
    from control import matlab

    system = state_space(model)
    places = (type(system), control, matlab)
    function = next((getattr(each, name) for each in places if hasattr(each, name)), None)
    if isfunction(function):

        def call(*arguments: Any, inputs: Names = None, outputs: Names = None, **more: Any) -> Any:
            return function(state_space(chosen(model, inputs, outputs)), *arguments, **more)

        return call
    if not hasattr(system, name):
        raise no_attribute(model, name, *dir(system))
    return getattr(system, name)


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
        attrs={"model": model.model.title},
    )
