"""Conversion of a linear model to objects of other packages."""

from __future__ import annotations

from inspect import isfunction, signature
from typing import TYPE_CHECKING, Any

from hfa_support.errors import BadInputError, on_one_line
from hfa_support.unknown import attribute_of
from trim.linear.reduction import Names, chosen

if TYPE_CHECKING:
    from collections.abc import Iterable

    import control

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

    The function may also be one of python-control's MATLAB interface. Its call accepts inputs= and
    outputs=, which select the transfer functions. Both may also be input= and output=, or the first
    two texts of the call. A function whose first arguments are matrices, such as ctrb(A, B), is
    called with the model's matrices.

    Raises BadInputError for an error of python-control, and AttributeError for another name.
    """
    import control
    from control import matlab

    system = state_space(model)
    places = (type(system), control, matlab)
    function = next((getattr(each, name) for each in places if hasattr(each, name)), None)
    if isfunction(function):
        wanted = signature(function).parameters

        def call(*arguments: Any, inputs: Names = None, outputs: Names = None, **more: Any) -> Any:
            inputs = more.pop("input", inputs)
            outputs = more.pop("output", outputs)
            others = list(arguments)
            if len(others) > 1 and isinstance(others[0], str):
                inputs, outputs, *others = others
            system = state_space(chosen(model, inputs, outputs))
            matrices = [getattr(system, each) for each in _leading_matrices(wanted)]
            try:
                return function(*(matrices or [system]), *others, **more)
            except Exception as error:  # whatever python-control raises
                raise BadInputError(
                    f"python-control's {name}: {on_one_line(str(error))}"
                ) from error

        return call
    if not hasattr(system, name):
        functions = [each for each, value in vars(control).items() if isfunction(value)]
        return attribute_of(model, name, *dir(system), *functions)
    return getattr(system, name)


def _leading_matrices(names: Iterable[str]) -> list[str]:
    """Return the names A, B, C, D with which the arguments of a function begin: A and B for ctrb(A,
    B).
    """
    leading = []
    for name in names:
        if name not in ("A", "B", "C", "D"):
            break
        leading.append(name)
    return leading
