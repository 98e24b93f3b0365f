"""Labelled matrices, and blocks of a matrix, in the order of a plant."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, shortened


def in_order(name: str, matrix: Any, rows: tuple[str, ...], columns: tuple[str, ...]) -> Any:
    """Return a matrix with its rows and columns in the order of these names.

    A frame of pandas or polars, or an array of xarray, is matched by its labels: each of them must
    be a name. Labels that are numbers, and matrices without labels, are in the order of the names.

    Raises BadInputError for other labels.
    """
    labels = _labels(matrix)
    if labels is None:
        return matrix
    numbers = np.asarray(matrix.to_numpy())
    for axis, (stated, names) in enumerate(zip(labels, (rows, columns), strict=False)):
        is_numbered = all(re.fullmatch(r"(column_)?\d+", str(label)) for label in stated)
        if is_numbered or not all(isinstance(label, str) for label in stated):
            continue
        if sorted(stated) != sorted(names):
            side = ("rows", "columns")[axis]
            raise BadInputError(
                f"{name} has the {side} {shortened(', '.join(stated), 200)}; give "
                f"{', '.join(names)}, or {name}.to_numpy() in this order"
            )
        numbers = np.take(numbers, [list(stated).index(each) for each in names], axis)
    return numbers


def _labels(matrix: Any) -> list[list[Any]] | None:
    """Return the labels of the rows and of the columns of a matrix, or None if it has none."""
    if hasattr(matrix, "coords") and hasattr(matrix, "dims"):  # xarray
        axes = [matrix.coords.get(axis) for axis in matrix.dims]
        return [[] if axis is None else axis.to_numpy().tolist() for axis in axes]
    if not (hasattr(matrix, "to_numpy") and hasattr(matrix, "columns")):
        return None
    of_rows = list(matrix.index) if hasattr(matrix, "index") else []  # polars has none
    return [of_rows, list(matrix.columns)]


def blocks_in_order(
    name: str, stated: tuple[str, ...], own: dict[str, tuple[str, ...]]
) -> list[int]:
    """Return the places in a square matrix of the signals of a plant, block by block.

    stated: names of the signals of the matrix, or of its blocks, in the order of the matrix
    own: block, such as "x" -> names of its signals, in the wanted order. Blocks that the matrix
        lacks are left out

    Raises BadInputError for other names.
    """
    names = [each for word in stated for each in own.get(word, (word,))]
    wanted = [each for block in own.values() if set(block) & set(names) for each in block]
    if sorted(names) != sorted(wanted):
        signals = ", ".join(each for block in own.values() for each in block)
        raise BadInputError(
            f"{name} lists {shortened(', '.join(stated), 200)}; give the blocks "
            f"{', '.join(own)}, or their signals ({shortened(signals, 200)}), each of them once"
        )
    return [names.index(each) for each in wanted]
