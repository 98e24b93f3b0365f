"""Labelled arrays of pandas, polars and xarray, put into the order of the signals of a plant."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from hfa_support.errors import BadInputError, shortened


def labels_of(value: Any) -> list[tuple[str, ...]]:
    """Return the labels along each axis of a labelled array, () for an axis that is numbered.

    An array of pandas or polars, or of xarray, has labels. Another value has no axes with labels,
    [].
    """
    if hasattr(value, "coords") and hasattr(value, "dims"):  # xarray
        axes = [value.coords.get(axis, ()) for axis in value.dims]
        axes = [axis.to_numpy().tolist() if len(axis) else axis for axis in axes]
    elif hasattr(value, "to_dicts"):  # polars
        axes = [(), value.columns]
    else:  # pandas
        axes = value.axes if hasattr(type(value), "loc") else []
    return [tuple(axis) if _are_names(axis) else () for axis in axes]


def _are_names(labels: Sequence[Any]) -> bool:
    """Return whether labels of an axis are names, and not numbers."""
    has_texts = any(isinstance(label, str) for label in labels)
    return has_texts and not all(re.fullmatch(r"(column_)?\d+", str(label)) for label in labels)


def in_order(what: str, value: Any, *orders: Sequence[str]) -> Any:
    """Return a labelled array as numbers in the given order, and another value unchanged.

    what: name of the array, for messages
    orders: names along each axis, () for an axis that keeps its order; an array with fewer axes has
        the last ones

    Raises BadInputError unless the labels of each axis are the names of its order, in any order.
    """
    labels = labels_of(value)
    if not labels:
        return value
    numbers = value.to_numpy()
    for axis, (given, order) in enumerate(zip(labels, orders[-len(labels) :], strict=False)):
        if not given or not order:
            continue
        if sorted(map(str, given)) != sorted(order):
            raise BadInputError(
                f"{what} has the labels {shortened(', '.join(map(str, given)), 200)}; label each "
                f"of {', '.join(order)} once, or give {what}.to_numpy() in this order"
            )
        numbers = numbers.take([given.index(name) for name in order], axis=axis)
    return numbers
