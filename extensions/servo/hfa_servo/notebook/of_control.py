"""Functions of python-control as methods of a linear model."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import isfunction, signature
from typing import Any

from hfa_servo.notebook.arguments import keywords, leading_names
from hfa_support.errors import BadInputError, on_one_line
from trim.linear.exchange import state_space
from trim.linear.linear_model import LinearModel
from trim.linear.reduction import Names, chosen


def of_control(model: LinearModel, name: str) -> Any:
    """Return the function or attribute of python-control with this name for a linear model, or
    None.

    The name is looked up in StateSpace, python-control and its MATLAB interface. A returned
    function

    - selects transfer functions by inputs= and outputs=, or by the first strings of the call,
    - receives the matrices of the model if its first parameters are matrices, as in ctrb(A, B),
    - raises BadInputError for an error of python-control.
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
            names, others = leading_names(arguments)
            inputs = names[0] if names else inputs
            outputs = names[1] if len(names) > 1 else outputs
            more = keywords(list(wanted), more)
            system = state_space(chosen(model, inputs, outputs))
            matrices = [getattr(system, each) for each in _leading_matrices(wanted)]
            try:
                return function(*(matrices or [system]), *others, **more)
            except Exception as error:  # python-control raises many kinds of errors
                reason = on_one_line(str(error))
                if len(system.input_labels) > 1 and inputs is None:
                    reason += "; for a single loop give inputs=NAME, outputs=NAME"
                raise BadInputError(f"python-control's {name}: {reason}") from error

        return call
    return getattr(system, name, None)


def names_of_control() -> list[str]:
    """Return the names of python-control's functions."""
    import control

    return [name for name, value in vars(control).items() if isfunction(value)]


def _leading_matrices(names: Iterable[str]) -> list[str]:
    """Return the leading parameters of a function that are matrices A, B, C or D, as in ctrb(A,
    B).
    """
    leading = []
    for name in names:
        if name not in ("A", "B", "C", "D"):
            break
        leading.append(name)
    return leading
