"""Time and frequency responses of a linear model, computed by python-control."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, is_finite, numbers_in, refuse_unknown, shown
from trim.linear.transfer import System

if TYPE_CHECKING:
    import control
    from matplotlib.axes import Axes


def response(system: System, kind: str, time: float | ArrayLike | None) -> control.TimeResponseData:
    """Return the response of each output to each input, (outputs, inputs, N).

    kind: "step" or "impulse", of size 1
    time: (N,), or the last time; None for python-control's default

    Raises BadInputError if `time` is neither a positive number nor increasing times.
    """
    import control

    respond = getattr(control, f"{kind}_response")
    return respond(system.to_control(), _checked_time(time), squeeze=False)


def _checked_time(time: Any) -> Any:
    """Return the last time as a float, times as an array (N,), or None."""
    if time is None:
        return None
    times = numbers_in("time", time)
    if times.ndim == 0 and np.isfinite(times) and times > 0.0:
        return float(times)
    if (
        times.ndim == 1
        and times.size > 1
        and np.isfinite(times).all()
        and (np.diff(times) > 0).all()
    ):
        return times
    raise BadInputError(
        f"time is {shown(time)}; give a positive number, or increasing times such as "
        "np.linspace(0, 10)"
    )


def simulated(
    system: System, u: Any, time: Any, initial: Any, dt: float | None
) -> control.TimeResponseData:
    """Return the response of the outputs to given inputs, (outputs, N).

    u: (m, N) or (N, m), or name of an input -> its number or its N values; other inputs are 0
    time: (N,), evenly spaced, or the last time; None for the times of a step response
    initial: (n,), or name of a state -> its initial deviation; other states are 0
    dt: sample time in place of an array of times, s, or None

    Raises BadInputError if a name is unknown, shapes disagree, u is a function or dt is not a
    positive number.
    """
    import control

    state_space = system.to_control()
    named = {} if u is None else u
    is_named = isinstance(named, Mapping)
    if callable(named):
        raise BadInputError(
            "u is a function; give the values of u at the times, or numbers by input"
        )
    time = _times(state_space, time, dt, None if is_named else max(np.shape(u), default=0))
    if is_named:
        rows = _values("input", named, tuple(system.inputs))
        for name, row in zip(system.inputs, rows, strict=True):
            if row.shape not in ((), time.shape):
                raise BadInputError(
                    f"input {name} has shape {row.shape}, but there are {time.size} times; give "
                    f"{time.size} values, or one number"
                )
        u = np.reshape([np.broadcast_to(row, time.shape) for row in rows], (-1, time.size))
    values = np.array(u, dtype=float, ndmin=2)
    wanted = (len(system.inputs), time.size)
    if values.shape == wanted[::-1] != wanted:
        values = values.T
    if values.shape != wanted:
        raise BadInputError(
            f"u has shape {np.shape(u)}; give {wanted}, one row for each input, or a dictionary "
            "of inputs"
        )
    x = initial if initial is not None else {}
    if isinstance(x, Mapping):
        x = np.array(_values("state", x, tuple(system.states)))
    start = numbers_in("initial", x)
    if start.shape != (len(system.states),):
        raise BadInputError(
            f"initial has shape {start.shape}; give an array of shape ({len(system.states)},)"
        )
    return control.forced_response(state_space, time, values, start, squeeze=False)


def _times(system: control.StateSpace, time: Any, dt: float | None, count: int | None) -> Any:
    """Return the times of a simulation, (N,)."""
    # time (N,)
    import control

    time = _checked_time(time)
    if dt is not None and not (is_finite(dt) and dt > 0.0):
        raise BadInputError(f"dt is {shown(dt)}; give a positive number of s")
    if dt is not None and time is None and count is not None:
        return dt * np.arange(count)
    if (time is None and count is None) or isinstance(time, float):
        steps = control.step_response(system, time).time
        time = steps if dt is None else np.arange(0.0, steps[-1] + dt / 2.0, dt)
    if time is None or time.size < 2:
        raise BadInputError(
            "time has fewer than two values; give an array such as np.linspace(0, 10)"
        )
    return time


def _values(kind: str, named: Mapping[str, Any], names: Sequence[str]) -> list[np.ndarray]:
    """Return the value of each of `names` as an array, by default 0."""
    for name in named:
        refuse_unknown(f"unknown {kind}", name, names)
    return [np.asarray(named.get(name, 0.0), dtype=float) for name in names]


def bode(system: System) -> np.ndarray:
    """Draw Bode plots in a new pyplot figure and return its Axes."""
    from matplotlib import pyplot

    from trim.linear.frequency import draw_bode

    figure = pyplot.figure(layout="constrained")
    return np.array(draw_bode(system, figure).axes)


def draw_poles(system: System, title: str) -> Axes:
    """Draw the poles and zeros of a system in a new pyplot figure and return its Axes."""
    import control
    from matplotlib import pyplot

    axes: Axes = pyplot.figure(layout="constrained").subplots()
    control.pole_zero_plot(system.to_control(), ax=axes)
    axes.set_title(f"{title}: poles x and zeros o, 1/{system.time_unit}")
    return axes


def _refuse_several(system: System) -> None:
    """Raise BadInputError unless a system has one input and one output."""
    if len(system.inputs) != 1 or len(system.outputs) != 1:
        raise BadInputError(
            f"a single loop has one input and one output, not {len(system.inputs)} and "
            f"{len(system.outputs)}; select one of each with inputs= and outputs="
        )


def transfer_function(system: System) -> control.TransferFunction:
    """Return python-control's transfer function from one input to one output.

    Raises BadInputError for several inputs or outputs.
    """
    import control

    from trim.linear.frequency import transfers

    _refuse_several(system)
    (found,) = transfers(system)
    return control.zpk(
        found.zeros, found.poles, found.gain, inputs=[*system.inputs], outputs=[*system.outputs]
    )


def nyquist(system: System) -> Axes:
    """Draw the Nyquist plot from one input to one output in a new pyplot figure and return its
    Axes.

    Raises BadInputError for several inputs or outputs.
    """
    import control
    from matplotlib import pyplot

    _refuse_several(system)
    axes: Axes = pyplot.figure(layout="constrained").subplots()
    control.nyquist_plot(system.to_control(), ax=axes)
    ((output, to),) = system.outputs.items()
    ((name, given),) = system.inputs.items()
    axes.set_title(f"{output} / {name}, ({to.unit})/({given.unit})")
    return axes
