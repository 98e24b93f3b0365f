"""Labelled arrays of pandas, put into the order of the states and inputs of a plant."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hfa_support.errors import BadInputError


def labels_of(value: Any) -> list[tuple[str, ...]]:
    """Return the labels along each axis of an array of pandas, () for an axis numbered 0, 1, ...

    Another value has no axes with labels, [].
    """
    axes = getattr(value, "axes", None) if hasattr(type(value), "loc") else None
    if axes is None:
        return []
    return [tuple(axis) if any(isinstance(each, str) for each in axis) else () for axis in axes]


def in_order(what: str, value: Any, *orders: Sequence[str]) -> Any:
    """Return an array of pandas as numbers in the given order, and another value unchanged.

    what: name of the array, for messages
    orders: names along each axis, () for an axis that keeps its order

    Raises BadInputError unless the labels of each axis are the names of its order, in any order.
    """
    labels = labels_of(value)
    if not labels:
        return value
    numbers = value.to_numpy()
    for axis, (given, order) in enumerate(zip(labels, orders, strict=False)):
        if not given or not order:
            continue
        if sorted(given) != sorted(order):
            raise BadInputError(
                f"{what} has the labels {', '.join(map(str, given))}; label each of "
                f"{', '.join(order)} once, or give {what}.to_numpy() in this order"
            )
        numbers = numbers.take([given.index(name) for name in order], axis=axis)
    return numbers
