"""Conversion of models to and from python-control's `NonlinearIOSystem`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.about import About
from hfa_aircraft.model import Model
from hfa_aircraft.signals import PlantNames, Signal
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    import control


#: Note on every model made from matrices, and on one that was read with its offsets X0, U0.
LINEAR = "linear plant without limits; its trim is the origin"
LINEAR_WITH_OFFSETS = "linear plant without limits; its trim has the offsets of the file"


def is_linear_plant(model: Model) -> bool:
    """Return whether a model was made from matrices."""
    return not {LINEAR, LINEAR_WITH_OFFSETS}.isdisjoint(model.about.notes)


def plant_model(
    name: str,
    names: PlantNames,
    A: np.ndarray,
    B: np.ndarray,
    outputs: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None,
) -> Model:
    """Return the model x' = A x + B u, trimmed at the origin (`plant_about` has offsets).

    name: name of the model
    names: names and units of all states and inputs. An empty unit becomes 1.
    A: (n, n)
    B: (n, m)
    outputs: name of an output -> c (n,) and d (m,) of y = c x + d u. Outputs named like a state are
        ignored.
    """
    states = _signals(names.states, names.state_units)
    inputs = _signals(names.inputs, names.input_units)
    rows = {
        output: OutputRow(Signal(), c, d, np.zeros(0)) for output, (c, d) in (outputs or {}).items()
    }
    # There are no disturbances, {}, and E has no columns.
    return plant_about(name, states, inputs, {}, (A, B, np.zeros((len(A), 0))), rows, (LINEAR,))


class OutputRow(NamedTuple):
    """Output y = y0 + c (x - x0) + d (u - u0) + f w of a linear plant; y0 is its start value."""

    signal: Signal
    c: np.ndarray
    d: np.ndarray
    f: np.ndarray


def plant_about(
    name: str,
    states: Mapping[str, Signal],
    inputs: Mapping[str, Signal],
    disturbances: Mapping[str, Signal],
    matrices: tuple[np.ndarray, np.ndarray, np.ndarray],
    outputs: Mapping[str, OutputRow],
    notes: tuple[str, ...],
) -> Model:
    """Return the model x' = A (x - x0) + B (u - u0) + E w, trimmed at x0 and u0.

    name: name of the model
    states, inputs: signals, whose start values are x0 and u0
    disturbances: signals of w
    matrices: A (n, n), B (n, m) and E (n, l)
    outputs: name -> row. Outputs named like a state are ignored.
    notes: notes on the model
    """
    A, B, E = matrices
    rows = {output: row for output, row in outputs.items() if output not in states}
    x0 = [signal.start for signal in states.values()]
    u0 = [signal.start for signal in inputs.values()]

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        dx = [value - at for value, at in zip(x, x0, strict=True)]
        du = [value - at for value, at in zip(u, u0, strict=True)]
        rates = {
            state: _product(A[i], dx) + _product(B[i], du) + _product(E[i], w)
            for i, state in enumerate(states)
        }
        values = {
            output: _product(c, dx) + _product(d, du) + _product(f, w) + signal.start
            for output, (signal, c, d, f) in rows.items()
        }
        return rates, values

    return Model(
        name,
        states,
        inputs,
        equations,
        outputs={output: row.signal for output, row in rows.items()},
        disturbances=disturbances,
        trim=dict(zip(inputs, u0, strict=True)),
        about=About(notes=notes),
    )


def _product(row: np.ndarray, values: Sequence[Any]) -> Any:
    """Return the inner product of a row of numbers and a sequence of symbols."""
    return sum(row[j] * values[j] for j in range(len(row)))


def _signals(names: tuple[str, ...], units: tuple[str, ...]) -> dict[str, Signal]:
    """Return name -> signal without limits. An empty unit becomes 1."""
    return {name: Signal(unit or "1") for name, unit in zip(names, units, strict=True)}


def to_control(model: Model) -> control.NonlinearIOSystem:
    """Return a model as a python-control system x' = f(x, u, p), y = (states, outputs).

    Names are kept. Disturbances are 0.

    >>> import hfa
    >>> from hfa_aircraft import to_control
    >>> to_control(hfa.aircraft()).ninputs
    5
    """
    import control

    outputs = [*model.states, *model.outputs]
    vectors = model.layout.symbols("x", "u", "p")
    f, y = model.layout.expressions(vectors, outputs)

    def evaluated(expression: ca.SX) -> Callable[..., np.ndarray]:
        """Return an expression as the function (t, x, u, params) that python-control calls."""
        function = ca.Function("system", vectors, [expression])

        def at(_: float, x: np.ndarray, u: np.ndarray, params: dict[str, float]) -> np.ndarray:
            return np.array(function(x, u, [params[name] for name in model.parameters])).ravel()

        return at

    return control.nlsys(
        evaluated(f),
        evaluated(y),
        name="".join(character if character.isalnum() else "_" for character in model.title),
        states=list(model.states),
        inputs=list(model.inputs),
        outputs=outputs,
        params={name: signal.start for name, signal in model.parameters.items()},
    )


def from_control(
    system: control.NonlinearIOSystem, units: Mapping[str, str | Signal], **declared: Any
) -> Model:
    """Return the model of a python-control system whose functions accept CasADi symbols.

    units: name -> unit or `Signal`. The unit is 1 for names that are not given
    declared: further fields of `Model`

    Raises BadInputError if the system has no update function, is in discrete time, depends on time,
    or cannot be evaluated with symbols.
    """
    name = str(system.name)
    if getattr(system, "updfcn", None) is None:
        raise BadInputError(f"{name} has no update function; give a system made by control.nlsys")
    if system.dt:
        raise BadInputError(
            f"{name} is in discrete time, which is not supported; give a system in continuous time"
        )

    def signal(label: str, start: float = 0.0) -> Signal:
        """Return the declared signal of a label, or one with its unit, or 1 without one."""
        known = units.get(label, "1")
        return known if isinstance(known, Signal) else Signal(known, start=start)

    model = Model(
        name=name,
        states={label: signal(label) for label in system.state_labels},
        inputs={label: signal(label) for label in system.input_labels},
        parameters={label: signal(label, float(value)) for label, value in system.params.items()},
        outputs={label: signal(label) for label in _own_outputs(system)},
        equations=lambda x, u, p, w: _rates_and_outputs(system, 0.0, x, u, p),
        **declared,
    )
    _refuse_time_and_floats(system, model)
    return model


def _own_outputs(system: control.NonlinearIOSystem) -> list[str]:
    """Return the labels of the outputs that are neither states nor inputs."""
    others = (*system.state_labels, *system.input_labels)
    return [label for label in system.output_labels if label not in others]


def _rates_and_outputs(
    system: control.NonlinearIOSystem, time: Any, x: Any, u: Any, p: Any
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return state -> rate, and output -> value, from the functions of a python-control system."""
    params = dict(zip(system.params, p, strict=True))
    arguments = (time, _array_of(x), _array_of(u), params)
    rates = system.updfcn(*arguments)
    outputs = system.outfcn(*arguments) if system.outfcn else x  # y = x by default
    by_label = dict(zip(system.output_labels, outputs, strict=True))
    return (
        dict(zip(system.state_labels, rates, strict=True)),
        {label: by_label[label] for label in _own_outputs(system)},
    )


def _refuse_time_and_floats(system: control.NonlinearIOSystem, model: Model) -> None:
    """Raise BadInputError if a system depends on time, or turned a symbol into nan."""
    # float(symbol) and functions of math return nan for a symbol, without an exception.
    time = ca.SX.sym("t")
    columns = map(ca.vertsplit, model.layout.symbols("x", "u", "p"))
    with warnings.catch_warnings(action="ignore", category=FutureWarning):
        # CasADi warns about NumPy functions
        rates, outputs = _rates_and_outputs(system, time, *columns)
    if ca.depends_on(ca.vertcat(*map(ca.SX, (*rates.values(), *outputs.values()))), time):
        raise BadInputError(
            f"{model.name} depends on time, which is not supported; declare the time-dependent "
            "term as an input"
        )
    if model.layout.has_nan:
        raise BadInputError(
            f"{model.name} uses float or math, which cannot be evaluated with symbols; use "
            "functions of NumPy"
        )


def _array_of(vector: Any) -> np.ndarray:
    """Return a sequence of numbers or symbols as an array of objects, (n,)."""
    # np.array would try to convert each CasADi symbol into an array of its own.
    array = np.empty(len(vector), dtype=object)
    array[:] = list(vector)
    return array
