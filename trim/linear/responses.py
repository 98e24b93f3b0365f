"""Time and frequency responses of a linear model, computed by python-control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown
from trim.linear.reduction import Names, chosen

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes

    from trim.linear.linear_model import LinearModel


def response(
    model: LinearModel, kind: str, time: float | ArrayLike | None, inputs: Names, outputs: Names
) -> control.TimeResponseData:
    """Return the response of each output to each input, (outputs, inputs, N).

    kind: "step" or "impulse", of size 1
    time: (N,), or the last time; None for python-control's default
    inputs, outputs: selected names, or None for all
    """
    import control

    respond = getattr(control, f"{kind}_response")
    return respond(chosen(model, inputs, outputs).to_control(), time, squeeze=False)


def simulated(
    model: LinearModel, u: Any, time: Any, initial: Any, dt: float | None
) -> control.TimeResponseData:
    """Return the response of the outputs to given inputs, (outputs, N).

    u: (m, N) or (N, m), or name of an input -> its number or its N values; other inputs are 0
    time: (N,), evenly spaced, or the last time; None for the times of a step response
    initial: (n,), or name of a state -> its initial deviation; other states are 0
    dt: sample time in place of an array of times, s, or None

    Raises BadInputError if a name is unknown, shapes disagree or u is a function.
    """
    import control

    system = model.to_control()
    named = {} if u is None else u
    is_named = isinstance(named, Mapping)
    if callable(named):
        raise BadInputError(
            "u is a function; give the values of u at the times, or numbers by input"
        )
    time = _times(system, time, dt, None if is_named else max(np.shape(u), default=0))
    if is_named:
        rows = _values("input", named, model.inputs)
        for name, row in zip(model.inputs, rows, strict=True):
            if row.shape not in ((), time.shape):
                raise BadInputError(
                    f"input {name} has shape {row.shape}, but there are {time.size} times; give "
                    f"{time.size} values, or one number"
                )
        u = np.reshape([np.broadcast_to(row, time.shape) for row in rows], (-1, time.size))
    values = np.array(u, dtype=float, ndmin=2)
    wanted = (len(model.inputs), time.size)
    if values.shape == wanted[::-1] != wanted:
        values = values.T
    if values.shape != wanted:
        raise BadInputError(
            f"u has shape {np.shape(u)}; give {wanted}, one row for each input, or a dictionary "
            "of inputs"
        )
    x = initial if initial is not None else {}
    if isinstance(x, Mapping):
        x = np.array(_values("state", x, model.states))
    start = numbers_in("initial", x)
    if start.shape != (len(model.states),):
        raise BadInputError(
            f"initial has shape {start.shape}; give an array of shape ({len(model.states)},)"
        )
    return control.forced_response(system, time, values, start, squeeze=False)


def _times(system: control.StateSpace, time: Any, dt: float | None, count: int | None) -> Any:
    """Return the times of a simulation, (N,).

    time: (N,), or the last time; None for the times of a step response
    dt: sample time, s, or None
    count: number of given samples of u, or None

    Raises BadInputError if there are fewer than two times, or if samples of u are given with
    neither `time` nor `dt`.
    """
    import control

    if dt is not None and time is None and count is not None:
        return dt * np.arange(count)
    if (time is None and count is None) or (np.ndim(time) == 0 and time is not None):
        shown = control.step_response(system, time).time
        time = shown if dt is None else np.arange(0.0, shown[-1] + dt / 2.0, dt)
    time = np.asarray(time, dtype=float)
    if time.ndim != 1 or time.size < 2:
        raise BadInputError(
            "time has fewer than two values; give an array such as np.linspace(0, 10)"
        )
    return time


def _values(kind: str, named: Mapping[str, Any], names: Sequence[str]) -> list[np.ndarray]:
    """Return the value of each of `names` as an array. A name without a given value has the value
    0.

    named: name -> value
    kind: "input" or "state", for the message

    Raises BadInputError if `named` contains an unknown name.
    """
    for name in named:
        refuse_unknown(f"unknown {kind}", name, names)
    return [np.asarray(named.get(name, 0.0), dtype=float) for name in names]


def bode(model: LinearModel, inputs: Names, outputs: Names) -> np.ndarray:
    """Draw Bode plots of the named inputs and outputs in a new pyplot figure and return its
    Axes.
    """
    from matplotlib import pyplot

    from trim.linear.frequency import draw_bode

    figure = pyplot.figure(layout="constrained")
    return np.array(draw_bode(chosen(model, inputs, outputs), figure).axes)


def draw_poles(model: LinearModel) -> Axes:
    """Draw the poles and zeros of a model in a new pyplot figure and return its Axes."""
    import control
    from matplotlib import pyplot

    axes: Axes = pyplot.figure(layout="constrained").subplots()
    control.pole_zero_plot(model.to_control(), ax=axes)
    axes.set_title(f"{model.model.title}: poles x and zeros o, 1/{model.model.time_unit}")
    return axes


def _single(model: LinearModel, inputs: Names, outputs: Names) -> LinearModel:
    """Return a linear model reduced to one selected input and one selected output.

    Raises BadInputError if the selection contains several inputs or outputs.
    """
    loop = chosen(model, inputs, outputs)
    if len(loop.inputs) != 1 or len(loop.outputs) != 1:
        raise BadInputError(
            f"a single loop has one input and one output, not {len(loop.inputs)} and "
            f"{len(loop.outputs)}; select one of each with inputs= and outputs="
        )
    return loop


def transfer_function(
    model: LinearModel, inputs: Names, outputs: Names
) -> control.TransferFunction:
    """Return python-control's transfer function from one input to one output.

    Raises BadInputError if several inputs or outputs are selected.
    """
    import control

    from trim.linear.frequency import transfers

    (found,) = transfers(_single(model, inputs, outputs))
    return control.zpk(found.zeros, found.poles, found.gain)


def nyquist(model: LinearModel, inputs: Names, outputs: Names) -> Axes:
    """Draw the Nyquist plot from one input to one output in a new pyplot figure and return its
    Axes.

    Raises BadInputError if several inputs or outputs are selected.
    """
    import control
    from matplotlib import pyplot

    loop = _single(model, inputs, outputs)
    axes: Axes = pyplot.figure(layout="constrained").subplots()
    control.nyquist_plot(loop.to_control(), ax=axes)
    axes.set_title(
        f"{loop.outputs[0]} / {loop.inputs[0]}, ({loop.output_units[0]})/({loop.input_units[0]})"
    )
    return axes
