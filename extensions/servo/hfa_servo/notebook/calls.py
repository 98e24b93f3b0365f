"""Attributes and arguments in the words of other tools, and functions of `hfa` as methods."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from controller.riccati.gare import Solution
from controller.riccati.solution_report import AnalysedGame, solve
from hfa_aircraft.states_and_inputs import StatesAndInputs
from hfa_servo.notebook.arguments import accepts
from hfa_servo.notebook.frames import entries_frame, frame
from hfa_servo.notebook.of_control import names_of_control, of_control
from hfa_support.errors import nearest
from hfa_support.reporting.by_name import ByName
from hfa_support.reporting.report import Reported
from hfa_support.unknown import no_attribute
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint
from trim.sweeps.sweep import Sweep

_SAME_ATTRIBUTES = """
L: disturbance_gain
as_dict: to_dict
close: feedback
controllability: ctrb
controllable: is_controllable
damping_ratio: damping
discretize: sample
converged: ok
derivatives: rates_at
eigenvalues: closed_loop_eigenvalues
gain: K
gamma: delta
gamma_min: delta_min
hinfnorm: linfnorm
info: report
n_inputs: ninputs
n_outputs: noutputs
n_states: nstates
natural_frequency: frequency
margins: margin
observability: obsv
omega: frequency
passed: ok
regret: cost_lost
simulate: fly
sigma: singular_values_plot
stable: is_stable
suboptimality: cost_lost
success: ok
summary: report
t: time
to_csv: save
to_dataframe: to_pandas
to_mat: save
to_matlab: save
to_npz: save
u: inputs
value: cost
verdict: grade
wn: frequency
x: states
zeta: damping
"""
#: Attribute of results of SciPy, pandas or python-control -> attribute of the same meaning.
ATTRIBUTES = dict(line.split(": ") for line in _SAME_ATTRIBUTES.strip().splitlines())
#: Attributes that the analysis of a game adds to its solution.
_ANALYSED = {*AnalysedGame.__annotations__, *vars(AnalysedGame)}


def attribute(value: Any, name: str, *more: str) -> Any:
    """Return the attribute that a word of another tool means, or a function of `hfa` as a method.

    A function of `hfa` is a method of its first argument: model.linearize(point). A solution has
    the attributes that `hfa.solve` adds, and a linear model its modes: linear.phugoid.

    more: further attributes for the message

    Raises AttributeError, which suggests the nearest attributes, for another name.
    """
    if name in _ADDED:
        added = _ADDED[name](value)
        if added is not None:
            return added
    if isinstance(value, LinearModel):
        found = of_control(value, name)
        if found is not None:
            return found
        more = (*more, *dir(value), *names_of_control())
    same = ATTRIBUTES.get(name)
    if same is not None and hasattr(value, same):
        return getattr(value, same)
    if isinstance(value, LinearModel):
        for mode in value.modes:
            if mode.name.replace(" ", "_") == name:
                return mode
    if isinstance(value, ByName) and value and hasattr(value[0], name):
        return np.array([getattr(entry, name) for entry in value])
    is_series = isinstance(value, StatesAndInputs) and hasattr(value, "__getitem__")
    if is_series and not isinstance(value, (LinearModel, OperatingPoint)) and _in_pandas(name):
        return getattr(frame(value), name)
    if type(value) is Solution and name in _ANALYSED:
        return getattr(solve(value.game), name)
    method = _method(value, name)
    if method is not None:
        return method
    methods = [each for each in nearest(name, dir(_public())) if _method(value, each) is not None]
    names = [*value.keys()] if hasattr(type(value), "keys") else []
    if isinstance(value, ByName):
        names += dir(value[0]) if value else []
    raise no_attribute(value, name, *methods, *names, *more)


def _to_json(value: Any) -> Callable[..., Any] | None:
    """Return the method that returns a result as JSON, or writes it to a file."""
    if not isinstance(value, Reported):
        return None

    def to_json(path: str | Path | None = None) -> Any:
        return value.report().json() if path is None else value.save(Path(path))

    return to_json


def _to_series(value: Any) -> Callable[[], Any] | None:
    """Return the method that returns the values of an operating point by name."""
    if not isinstance(value, OperatingPoint):
        return None

    def to_series() -> Any:
        import pandas

        return pandas.Series(dict(value), name=value.model.title)

    return to_series


def _to_scipy(value: Any) -> Callable[[], Any] | None:
    """Return the method that returns a linear model as SciPy's `StateSpace`."""
    if not isinstance(value, LinearModel):
        return None

    def to_scipy() -> Any:
        from scipy.signal import StateSpace

        return StateSpace(*value)

    return to_scipy


def _plot(value: Any) -> Callable[[], Any] | None:
    """Return the method that draws the poles of the closed loop of a solution."""
    if not isinstance(value, Solution):
        return None

    def plot() -> Any:
        import control
        from matplotlib import pyplot

        axes = pyplot.figure(layout="constrained").subplots()
        control.pole_zero_plot(value.closed_loop, ax=axes)
        axes.set_title(f"{value.names.origin}: poles of A - B K, 1/s")
        return axes

    return plot


def _to_pandas(value: Any) -> Callable[[], Any] | None:
    """Return the method that returns a table of named entries, such as modes."""
    return partial(entries_frame, value) if isinstance(value, ByName) else None


def _linearize(value: Any) -> Callable[..., LinearModel] | None:
    """Return the method that returns a linear model itself, or with options that at its point."""
    if not isinstance(value, LinearModel):
        return None

    def linearize(**options: Any) -> LinearModel:
        return value.point.linearize(**options) if options else value

    return linearize


def _root_locus(value: Any) -> Callable[[], Any] | None:
    """Return the method that draws the root locus of a sweep."""
    return value.plot if isinstance(value, Sweep) else None


#: Attribute that is added to some results -> function from a result to its value, or None.
_ADDED: dict[str, Callable[[Any], Any]] = {
    "df": lambda value: value.to_pandas() if hasattr(value, "to_pandas") else None,
    "linearize": _linearize,
    "plot": _plot,
    "root_locus": _root_locus,
    "to_json": _to_json,
    "to_pandas": _to_pandas,
    "to_scipy": _to_scipy,
    "to_series": _to_series,
}


def _in_pandas(name: str) -> bool:
    """Return whether a table of pandas has the attribute."""
    import pandas

    return hasattr(pandas.DataFrame, name)


def _public() -> Any:
    """Return the module `hfa`, which no extension imports."""
    return import_module("hfa")


def _method(value: Any, name: str) -> Callable[..., Any] | None:
    """Return a function of `hfa` with its first argument given, or None where it has another."""
    function = getattr(_public(), name, None) if name in dir(_public()) else None
    if not inspect.isfunction(function):
        return None
    return partial(function, value) if accepts(function, value) else None
