"""Labeled arrays of pandas and xarray as arguments, with rows and columns aligned by name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from controller.game.names import PlantNames
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from hfa_aircraft.model import Model
from hfa_support.arguments import argument_tests
from hfa_support.errors import BadInputError, refuse_unknown
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint

#: Arguments of a function: positional arguments and keywords.
_Arguments = tuple[tuple[Any, ...], dict[str, Any]]
#: Constructors that accept arrays, and the names of their rows and columns.
_GAME = inspect.unwrap(Game.__init__)
_LINEAR_MODEL = inspect.unwrap(LinearModel.__init__)


def has_labels(value: Any) -> bool:
    """Return whether a value is an array of pandas or xarray."""
    return hasattr(type(value), "loc") and isinstance(getattr(value, "ndim", None), int)


def aligned(
    function: Callable[..., Any], arguments: tuple[Any, ...], named: dict[str, Any]
) -> _Arguments | None:
    """Return the arguments of a call, with its labeled arrays in the order of the states and
    inputs.

    - Labels that are strings are names of states or inputs. Other labels, such as times, are
      ignored.
    - A labeled vector becomes a dictionary if the function accepts values by name.
    - If no argument names the states and inputs, the rows and columns of labeled A and B name
      them.

    Returns None if no argument is labeled, or if the function reads tables as flight records.

    named: keywords of the call

    Raises BadInputError if a name is unknown, missing or repeated, if nothing in the call names the
    states, or if the labels of a matrix are the numbers 0, 1, ... in another order.
    """
    given = [*arguments, *named.values()]
    if not any(map(has_labels, given)) or "records" in inspect.signature(function).parameters:
        return None
    orders = [order for value in given for order in _orders(value) if order]
    states, inputs = (*(orders or _own_orders(given)), (), ())[:2]
    if function is _LINEAR_MODEL:
        states, inputs = (
            tuple(named.get(word, own)) for word, own in (("states", states), ("inputs", inputs))
        )
    orders = orders or [order for order in (states, inputs) if order]
    by_name = _accepts_names(function)

    def converted(what: str, value: Any) -> Any:
        return _in_order(what, value, orders, by_name) if has_labels(value) else value

    places = tuple(converted(type(value).__name__, value) for value in arguments)
    words = {word: converted(word, value) for word, value in named.items()}
    if function is _GAME:
        words = {"names": PlantNames(states, inputs)} | words
    if function is _LINEAR_MODEL:
        words = {"states": states, "inputs": inputs} | words
    return places, words


def _accepts_names(function: Callable[..., Any]) -> bool:
    """Return whether a function accepts a dictionary for at least one of its parameters."""
    tests = {name: holds for _, name, holds, _ in argument_tests(function, 0)}
    parameters = [name for name in inspect.signature(function).parameters if name != "self"]
    return any(name not in tests or tests[name]({"": 0.0}) for name in parameters)


def _orders(value: Any) -> tuple[tuple[str, ...], ...]:
    """Return the names of the states and of the inputs of an argument, each in order.

    For an aircraft or operating point, the names of the states of the nonlinear aircraft follow.
    For another value, the result is empty.
    """
    if isinstance(value, Solution):
        value = value.game
    if isinstance(value, Game):
        return value.names.states, value.names.inputs
    if isinstance(value, LinearModel):
        return value.states, value.inputs
    model = value.model if isinstance(value, OperatingPoint) else value
    if isinstance(model, Model):
        return model.linear, tuple(model.inputs), tuple(model.states)
    return ()


def _own_orders(given: Sequence[Any]) -> list[tuple[str, ...]]:
    """Return the names of the states and of the inputs in the labels of the matrices A and B.

    Returns an empty list if the first array of the call is not a labeled A.

    given: arguments of the call
    """
    arrays = [
        value for value in given if has_labels(value) or isinstance(value, (list, np.ndarray))
    ]
    tables = [_labels(value) for value in arrays if has_labels(value) and value.ndim == 2]
    if not tables or not has_labels(arrays[0]):
        return []
    states, columns = tables[0]
    if not states or {*states} != {*columns}:
        return []
    inputs = [tuple(names) for rows, names in tables if {*rows} == {*states} != {*names}]
    return [tuple(states), *inputs[:1]]


def _labels(value: Any) -> list[list[str]]:
    """Return the labels along each axis of a labeled array, or [] for an axis without strings.

    Raises BadInputError if the labels of a matrix are the numbers 0, 1, ... in another order.
    """
    axes = value.axes if hasattr(value, "axes") else [value.indexes.get(dim) for dim in value.dims]
    names = []
    for axis in axes:
        labels = [] if axis is None else list(axis)
        numbers = list(range(len(labels)))
        if len(axes) > 1 and labels != numbers and {*labels} == {*numbers}:
            raise BadInputError(
                f"the labels of the {type(value).__name__} are {labels}; label rows and columns "
                "by name, or write .to_numpy() to use positions"
            )
        names.append(labels if any(isinstance(label, str) for label in labels) else [])
    return names


def _in_order(what: str, value: Any, orders: Sequence[Sequence[str]], by_name: bool) -> Any:
    """Return a labeled array as a NumPy array in the order of the states and inputs.

    what: name of the argument, for messages
    orders: names of the states, and of the inputs
    by_name: whether a vector with names is returned as a dictionary instead
    """
    labels = _labels(value)
    array = np.asarray(value)
    if by_name and array.ndim == 1 and labels[0]:
        return dict(zip(labels[0], array.tolist(), strict=True))
    for axis, names in enumerate(labels):
        if names:
            array = array.take(_places(what, names, orders), axis=axis)
    return array


def _places(what: str, names: list[str], orders: Sequence[Sequence[str]]) -> list[int]:
    """Return the index in the labels of an axis of each state, or of each input.

    what: name of the argument, for messages
    names: labels of the axis
    orders: names of the states, and of the inputs

    Raises BadInputError unless the labels are the names of all states, or of all inputs.
    """
    remedy = f"write {what}.to_numpy() to read it by position"
    if not orders:
        raise BadInputError(f"{what} has labels, but no argument names the states; {remedy}")
    for order in orders:
        if len(names) == len(order) and {*names} == {*order}:
            return [names.index(name) for name in order]
    nearest = max(orders, key=lambda order: len({*order} & {*names}))
    for name in names:
        refuse_unknown(f"{what} has the unknown label", name, nearest)
    missing = [name for name in nearest if name not in names]
    wrong = f"has no label {missing[0]!r}" if missing else "has a label twice"
    raise BadInputError(f"{what} {wrong}; label every state or input once, or {remedy}")
