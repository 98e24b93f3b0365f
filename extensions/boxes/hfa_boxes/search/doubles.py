"""Evaluation of a program at many points in double precision.

No proof depends on these values.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from verification.enclosure.program import Argument, Program

_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "product": np.multiply,
    "relu": lambda t: np.maximum(t, 0.0),
    "step": lambda t: np.where(t > 0.0, 1.0, 0.0),
    "tanh": np.tanh,
    "sin": np.sin,
    "cos": np.cos,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "inverse": np.reciprocal,
    "atan": np.arctan,
}
#: Number of points at a time, whose values fit in the cache of a processor.
_TOGETHER = 4000


def values_at(program: Program, points: np.ndarray) -> np.ndarray:
    """Return the outputs (N, outputs) of a program at points (N, inputs).

    An output is inf or nan where it is undefined.
    """
    with np.errstate(all="ignore"):
        parts = [
            _values_at(program, points[first : first + _TOGETHER])
            for first in range(0, max(len(points), 1), _TOGETHER)
        ]
    return np.concatenate(parts)


def _values_at(program: Program, points: np.ndarray) -> np.ndarray:
    known = [np.vstack([np.ones(len(points)), points.T])]
    for group in program.groups:
        arguments = [_rows(argument, known) for argument in group.arguments]
        known.append(_FUNCTIONS[group.kind](*arguments))
    return _rows(program.outputs, known).T


def _rows(argument: Argument, known: Sequence[np.ndarray]) -> np.ndarray:
    """Return the values (nodes, N) of one argument of all nodes of a group.

    known: values (variables, N) of each earlier group
    """
    total = np.zeros((1, known[0].shape[1]))
    for group, block in argument.blocks.items():
        total = total + block @ known[group]
    return total
