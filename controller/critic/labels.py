"""Labelled matrices, and blocks of a matrix, in the order of a plant."""

from __future__ import annotations

import re
from itertools import chain
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
    names_or_blocks: tuple[str, ...], blocks: dict[str, tuple[str, ...]]
) -> list[int]:
    """Return the places in H of the signals of a plant, block by block.

    names_or_blocks: H_signals of a file: names of the signals of H, or of its blocks, in its order
    blocks: block, such as "x" -> names of its signals, in the order of the plant. Blocks that H
        lacks are left out

    Raises BadInputError for other names.

    >>> blocks_in_order(("u", "beta", "alpha"), {"x": ("alpha", "beta"), "u": ("e",)})
    [2, 1, 0]
    """
    in_matrix = [signal for word in names_or_blocks for signal in blocks.get(word, (word,))]
    present = [signals for signals in blocks.values() if set(signals) & set(in_matrix)]
    in_plant = list(chain.from_iterable(present))
    if sorted(in_matrix) != sorted(in_plant):
        signals = ", ".join(chain.from_iterable(blocks.values()))
        raise BadInputError(
            f"H_signals lists {shortened(', '.join(names_or_blocks), 200)}; give the blocks "
            f"{', '.join(blocks)}, or their signals ({shortened(signals, 200)}), each of them once"
        )
    return [in_matrix.index(signal) for signal in in_plant]
