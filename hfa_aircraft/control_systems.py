"""Linear plants of matrices as models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.about import About
from hfa_aircraft.model import Model
from hfa_aircraft.signals import PlantNames, Signal

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
