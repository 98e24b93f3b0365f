"""Linear models from given matrices: x' = A x + B u, y = C x + D u, trimmed at the origin."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from controller.game.names import PlantNames
from controller.game.zero_sum import LARGEST, checked_matrix, shape_text
from hfa_aircraft.extras import Extras
from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal, record
from hfa_support.errors import BadInputError
from hfa_support.reporting.text import numbered
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint
from trim.point.status import Status

#: Note on every model made from matrices.
LINEAR = "linear plant without limits; its trim is the origin"
_NAME = "linear plant"


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
    shown = {output: row for output, row in (outputs or {}).items() if output not in names.states}

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        rates = {
            state: _product(A[i], x) + _product(B[i], u) for i, state in enumerate(names.states)
        }
        return rates, {output: _product(c, x) + _product(d, u) for output, (c, d) in shown.items()}

    states = _signals(names.states, names.state_units)
    inputs = _signals(names.inputs, names.input_units)
    return Model(
        name,
        states,
        inputs,
        equations,
        outputs={output: Signal() for output in shown},
        trim=dict.fromkeys(inputs, 0.0),
        extras=Extras(notes=(LINEAR,)),
    )


def _product(row: np.ndarray, values: Sequence[Any]) -> Any:
    """Return the inner product of a row of numbers and a sequence of symbols."""
    return sum(row[j] * values[j] for j in range(len(row)))


def _signals(names: tuple[str, ...], units: tuple[str, ...]) -> dict[str, Signal]:
    """Return name -> signal without limits. An empty unit becomes 1."""
    return {name: Signal(unit or "1") for name, unit in zip(names, units, strict=True)}


def completed(linear: LinearModel) -> dict[str, Any]:
    """Return all fields of a linear model, derived from A, B and the fields that are given.

    By default, C is the identity and D is 0. States are named x1, x2, ..., and inputs u1, u2, ....
    Outputs are named like the states, or y1, y2, ... if C is given.

    Raises BadInputError if a matrix does not consist of numbers, if shapes or numbers of names
    disagree, or if disturbances or E are given.
    """
    A = checked_matrix("A", linear.A, LARGEST)
    B = checked_matrix("B", linear.B, LARGEST)
    n = len(A)
    m = B.shape[1]
    for name, matrix, shape in (("A", A, (n, n)), ("B", B, (n, m))):
        if matrix.shape != shape or not matrix.size:
            raise BadInputError(
                f"{name} is {shape_text(matrix.shape)}; give {shape_text(shape)}, with at least "
                "one state and one input"
            )
    names = PlantNames(tuple(linear.states), tuple(linear.inputs)).completed(n, m)
    C = np.eye(n) if linear.C is None else checked_matrix("C", linear.C, LARGEST)
    D = np.zeros((len(C), m)) if linear.D is None else checked_matrix("D", linear.D, LARGEST)
    for name, matrix, width in (("C", C, n), ("D", D, m)):
        if matrix.shape != (len(C), width):
            wanted = shape_text((len(C), width))
            raise BadInputError(f"{name} is {shape_text(matrix.shape)}; give {wanted}")
    usual = names.states if linear.C is None else numbered("y", len(C))
    outputs = tuple(linear.outputs) or usual
    if len(outputs) != len(C):
        raise BadInputError(
            f"outputs has {len(outputs)} names, but C has {len(C)} rows; give a name for each row"
        )
    disturbances = tuple(linear.disturbances)
    if disturbances or linear.E is not None:
        raise BadInputError(
            "a linear model from matrices cannot have disturbances; pass E to hfa.game"
        )
    model = plant_model(_NAME, names, A, B, dict(zip(outputs, zip(C, D, strict=True), strict=True)))
    origin = OperatingPoint(
        record(names.states)(*np.zeros(n).tolist()),
        record(names.inputs)(*np.zeros(m).tolist()),
        {},
        Status.TRIMMED,
        model,
    )
    return {
        "A": A,
        "B": B,
        "C": C,
        "D": D,
        "E": np.zeros((n, 0)),
        "F": np.zeros((len(C), 0)),
        "states": names.states,
        "inputs": names.inputs,
        "outputs": outputs,
        "output_offsets": np.zeros(len(C)),
        "point": origin,
    }
