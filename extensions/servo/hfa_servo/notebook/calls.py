"""Attributes of results under names of other tools, and functions of `hfa` as methods of
results.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial, reduce
from importlib.util import find_spec
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.gare import Solution, solve
from controller.riccati.smallest_delta import minimum_delta
from hfa_aircraft.states_and_inputs import StatesAndInputs
from hfa_servo.notebook.added import ADDED
from hfa_servo.notebook.arguments import accepts
from hfa_servo.notebook.frames import frame
from hfa_servo.notebook.of_control import names_of_control, of_control
from hfa_servo.notebook.public import public
from hfa_support.errors import nearest
from hfa_support.reporting.by_name import ByName
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import Result, declared_entries
from hfa_support.unknown import no_attribute
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint
from trim.sweeps.sweep import Sweep

_SAME_ATTRIBUTES = """
L: disturbance_gain
U0: input_offsets
X0: state_offsets
as_dict: to_dict
close: feedback
controllability: ctrb
controllable: is_controllable
converged: ok
damping_ratio: damping
delay_margin: delay_limit
derivatives: rates_at
discretize: sample
eigenvalues: closed_loop_eigenvalues
explanation: reason
f: rates_at
gain: K
gamma: delta
gamma_min: delta_min
gramian: gram
hinfnorm: linfnorm
info: report
jacobian: at
message: reason
n_inputs: ninputs
n_outputs: noutputs
n_states: nstates
natural_frequency: frequency
observability: obsv
omega: frequency
output_names: outputs
params: parameters
passed: ok
plot_bode: bode
plot_modes: plot
plot_nyquist: nyquist
plot_poles: plot
regret: cost_lost
sel: at
sigma: singular_values_plot
simulate: fly
smallest_delta: delta_min
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
u0: input_offsets
value: cost
why: reason
wn: frequency
x: states
x0: state_offsets
zeta: damping
"""
#: Attribute of results of SciPy, pandas or python-control -> equivalent attribute of this project.
ATTRIBUTES = dict(line.split(": ") for line in _SAME_ATTRIBUTES.strip().splitlines())
#: Attributes that `hfa.solve` adds to a solution.
ANALYSED = {*Solution.__annotations__, *vars(Solution)}
#: Attributes of a solution that a game does not have.
_SOLVED = {*ANALYSED, *Solution.__annotations__, "poles", "margins", "closed_loop", "is_stable"}


class _Number(float):
    """Number that returns its value when called. Hence game.delta_min and game.delta_min() are
    equal.
    """

    def __call__(self) -> float:
        """Return the number."""
        return float(self)


def attribute(value: Any, name: str, *more: str) -> Any:
    """Return an attribute of a result that the class of the result does not define.

    The attribute is that of the first function in `_SOURCES` that finds one.

    more: further attribute names that the message may suggest

    Raises AttributeError with the most similar names if no function finds the attribute.
    """
    for source in _SOURCES:
        found = source(value, name)
        if found is not None:
            return found
    methods = [each for each in nearest(name, dir(public())) if _method(value, each) is not None]
    raise no_attribute(value, name, *methods, *_known(value), *more)


def _known(value: Any) -> list[str]:
    """Return attribute names that messages may suggest in addition to attributes of the class."""
    if isinstance(value, LinearModel):
        return [*dir(value), *names_of_control()]
    if isinstance(value, ByName) and value:
        return [*value.keys(), *dir(value[0])]
    return [*value.keys()] if hasattr(type(value), "keys") else []


def _added(value: Any, name: str) -> Any:
    """Return the method of this name that `ADDED` defines for a result, or None."""
    return ADDED[name](value) if name in ADDED else None


def _of_control(value: Any, name: str) -> Any:
    """Return the function of python-control with this name for a linear model.

    Returns None if the function does not exist, or if the value is not a linear model.
    """
    return of_control(value, name) if isinstance(value, LinearModel) else None


def _of_same_meaning(value: Any, name: str) -> Any:
    """Return the attribute of a result that other tools call by this name, or None."""
    same = ATTRIBUTES.get(name)
    return None if same is None else getattr(value, same, None)


def _mode(value: Any, name: str) -> Any:
    """Return the mode of a linear model with this name, as in linear.short_period, or None."""
    modes = value.modes if isinstance(value, LinearModel) else ()
    return next((mode for mode in modes if mode.name.replace(" ", "_") == name), None)


def _of_entries(value: Any, name: str) -> Any:
    """Return an attribute of all entries of a list as an array, as in modes.damping, or None."""
    is_attribute = isinstance(value, ByName) and value and hasattr(value[0], name)
    return np.array([getattr(entry, name) for entry in value]) if is_attribute else None


def _by_key(value: Any, name: str) -> Any:
    """Return the value that files of a result store under this key, as in point.delay_limit, or
    None.
    """
    entries = declared_entries(type(value)) if isinstance(value, Result) else ()
    path = next((entry.path for entry in entries if entry.name == name), ())
    return reduce(lambda held, each: getattr(held, each, None), path, value) if path else None


def _analysed(value: Any, name: str) -> Any:
    """Return an attribute of a solution or of a game that requires further computation, or None.

    - a solution: an attribute that `hfa.solve` adds
    - a game: its smallest delta

    Raises AttributeError if an attribute of a solution is requested from a game.
    """
    if isinstance(value, Game) and name in _SOLVED - {"delta_min"}:
        raise AttributeError(f"Game has no attribute {name!r}; write game.solve().{name}")
    if type(value) is Solution and name in ANALYSED:
        return getattr(solve(value.game), name)
    is_asked = isinstance(value, Game) and name == "delta_min"
    return _Number(minimum_delta(value).value) if is_asked else None


def _of_closed_loop(value: Any, name: str) -> None:
    """Raise AttributeError if a function of python-control is requested from a solution.

    The input of the solution's closed loop is the disturbance. A call such as `solution.step` would
    therefore be ambiguous.
    """
    if isinstance(value, Solution) and name in names_of_control():
        kind = type(value).__name__
        raise AttributeError(
            f"{kind} has no attribute {name!r}; write control.{name}(solution.closed_loop), from "
            "the disturbance to the states"
        )


def _of_another_link(value: Any, name: str) -> Any:
    """Return an entry of the report of an operating point, such as point.loads, or None.

    Raises AttributeError if the attribute belongs to the linear model at this point, to the
    operating point of a linear model, or to the modes of a sweep.
    """
    other = ""
    if isinstance(value, OperatingPoint):
        data = value.report().data
        if name in data:
            return data[name]
        of_linear = (*dir(LinearModel), *LinearModel.__annotations__, *names_of_control())
        if {name, ATTRIBUTES.get(name)} & {*of_linear}:
            other = f"point.linearize().{name}"
    elif isinstance(value, LinearModel) and name in value.model.signals:
        other = f"linear.point.{name}"
    elif isinstance(value, Sweep) and name.replace("_", " ") in list(value.modes.keys()):
        other = f"sweep.modes[{name.replace('_', ' ')!r}]"
    if other:
        raise AttributeError(f"{type(value).__name__} has no attribute {name!r}; write {other}")
    return None


def _in_degrees(value: Any, name: str) -> Any:
    """Return an angle of a result in degrees, as in point.alpha_deg, or None."""
    angle = name.removesuffix("_deg")
    model = _declared(value, "model")
    if angle == name or angle not in getattr(model, "signals", ()):
        return None
    return np.degrees(value[angle]) if model.unit(angle).startswith("rad") else None


def _of_table(value: Any, name: str) -> Any:
    """Return the method of this name of a result's pandas table, or None.

    For a sweep or flight, every method of the table is found. For any other result, only methods
    `to_...` are found.
    """
    if not isinstance(value, Reported) or find_spec("pandas") is None:
        return None
    import pandas

    if not hasattr(pandas.DataFrame, name):
        return None
    is_series = isinstance(value, StatesAndInputs) and hasattr(value, "__getitem__")
    if is_series and not isinstance(value, (LinearModel, OperatingPoint)):
        return getattr(frame(value), name)
    return getattr(value.to_pandas(), name) if name.startswith("to_") else None


def _of_only_point(value: Any, name: str) -> Any:
    """Return an attribute of an assessment's only trim.

    Returns None if the assessment has several trims, or if the trim has no such attribute.
    """
    points = _declared(value, "points") if isinstance(value, Reported) else None
    if not isinstance(points, tuple) or len(points) != 1:
        return None
    (point,) = points
    found = getattr(point, name, None)
    return _by_key(point, ATTRIBUTES.get(name, name)) if found is None else found


def _declared(value: Any, name: str) -> Any:
    """Return the attribute of a value that its class or the value itself declares, or None."""
    is_declared = hasattr(type(value), name) or name in getattr(value, "__dict__", ())
    return getattr(value, name) if is_declared else None


def _method(value: Any, name: str) -> Callable[..., Any] | None:
    """Return a function of `hfa` with the value as its first argument.

    Returns None if the function does not exist or does not accept the value.
    """
    function = getattr(public(), name, None) if name in dir(public()) else None
    if not inspect.isfunction(function):
        return None
    return partial(function, value) if accepts(function, value) else None


#: Functions from a result and a name to an attribute, or None, in the order of their precedence.
_SOURCES = (
    _added,
    _of_control,
    _of_same_meaning,
    _mode,
    _of_entries,
    _by_key,
    _analysed,
    _in_degrees,
    _of_only_point,
    _method,
    _of_another_link,
    _of_closed_loop,
    _of_table,
)
