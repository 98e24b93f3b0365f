"""Model of a linear plant x' = A x + B u, y = C x + D u, trimmed at the origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hfa_aircraft.about import About
from hfa_aircraft.model import Model
from hfa_aircraft.names import PlantNames
from hfa_aircraft.signals import Signal

#: Note on every model made from matrices.
LINEAR = "linear plant without limits; its trim is the origin"


def plant_model(
    name: str,
    names: PlantNames,
    A: np.ndarray,
    B: np.ndarray,
    outputs: Mapping[str, tuple[np.ndarray, np.ndarray]] | None = None,
) -> Model:
    """Return the model x' = A x + B u, trimmed at the origin.

    name: name of the model
    names: names and units of all states and inputs. An empty unit becomes 1.
    A: (n, n)
    B: (n, m)
    outputs: name of an output -> c (n,) and d (m,) of y = c x + d u. Outputs named like a state are
        ignored.
    """
    rows = {output: row for output, row in (outputs or {}).items() if output not in names.states}

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        rates = {
            state: _product(A[i], x) + _product(B[i], u) for i, state in enumerate(names.states)
        }
        return rates, {output: _product(c, x) + _product(d, u) for output, (c, d) in rows.items()}

    states = _signals(names.states, names.state_units)
    inputs = _signals(names.inputs, names.input_units)
    return Model(
        name,
        states,
        inputs,
        equations,
        outputs={output: Signal() for output in rows},
        trim=dict.fromkeys(inputs, 0.0),
        about=About(notes=(LINEAR,)),
    )


def _product(row: np.ndarray, values: Sequence[Any]) -> Any:
    """Return the inner product of a row of numbers and a sequence of symbols."""
    return sum(row[j] * values[j] for j in range(len(row)))


def _signals(names: tuple[str, ...], units: tuple[str, ...]) -> dict[str, Signal]:
    """Return name -> signal without limits. An empty unit becomes 1."""
    return {name: Signal(unit or "1") for name, unit in zip(names, units, strict=True)}
