"""Critics over time, from a file or from the history of a learner."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from controller.critic.critic import Critic, from_parts
from controller.critic.features import is_list
from controller.critic.reading import DIMENSIONS, Reading, in_plant_units
from controller.game.basis import Basis, basis as named_basis
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from hfa_aircraft.readers.matrices_file import file_scales, words
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, numbers_in
from hfa_support.matrices import checked_matrix, shape_text


@checks_arguments
def critics_over_time(
    game: Game,
    times: np.ndarray,
    basis: str = "quadratic",
    **parts: np.ndarray | None,
) -> tuple[Critic, ...]:
    """Return the critic at each time of a learner's history.

    game: the game whose solution the critics approximate
    times: (N,), s, increasing, the first at least 0
    basis: name of the basis of W
    parts: W (N, M), P (N, n, n) or K (N, m, n), at least one of them. A single W (M,), P (n, n) or
        K (m, n) applies to the last time.

    Raises BadInputError
    - if a number is not finite or too large,
    - if a time is negative, or the times do not increase,
    - if no array has one row per time, or an array has another number of rows or a wrong shape,
    - if the name of the basis is unknown, or W and P define different values.

    >>> import hfa
    >>> import numpy as np
    >>> from controller import critics_over_time
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], delta=2.0)
    >>> weights = np.array([[1.0], [3.0]])
    >>> [critic.K.item() for critic in critics_over_time(game, np.array([0.0, 1.0]), W=weights)]
    [1.0, 3.0]
    """
    times = checked_matrix("time", times, LARGEST_CRITIC_ENTRY, ndim=None)
    arrays = {
        name: checked_matrix(name, parts[name], LARGEST_CRITIC_ENTRY, ndim=None)
        for name in DIMENSIONS
        if parts.get(name) is not None
    }
    rows = {name: array for name, array in arrays.items() if array.ndim == DIMENSIONS[name] + 1}
    if times.ndim != 1 or not len(times) or not rows:
        raise BadInputError(
            "the history is incomplete; give time with W (rows of weights), P or K (matrices)"
        )
    for row in np.flatnonzero(np.diff(times, prepend=-np.finfo(float).tiny) <= 0.0):
        raise BadInputError(
            f"time is {times[row]:g} s at row {row + 1}; give increasing times of at least 0 s"
        )
    for name, array in rows.items():
        if len(array) != len(times):
            raise BadInputError(
                f"{name} has {len(array)} rows, but time has {len(times)}; give one row per time"
            )
    psi = named_basis(basis, len(game.A))
    critics = []
    for index, time in enumerate(times.tolist()):
        parts_then = {name: array[index] for name, array in rows.items()}
        if index == len(times) - 1:
            parts_then |= {name: array for name, array in arrays.items() if name not in rows}
        critics.append(replace(from_parts(game, parts_then, psi), time=time))
    return tuple(critics)


def with_named_basis(reading: Reading, entries: Mapping[str, Any]) -> Reading:
    """Return the reading options, with the basis of W that a critic file names.

    The options are returned unchanged if they already set a basis, or if the file contains no W.

    entries: entries of the file, including "basis"

    Raises BadInputError if the entry "basis" is not a single text.
    """
    if reading.basis is not None or "W" not in entries:
        return reading
    named = words(entries, "basis")
    if len(named) != 1:
        raise BadInputError("the entry basis is not one name; give a name such as 'quadratic'")
    return replace(reading, basis=named[0])


def rows_over_time(
    entries: Mapping[str, Any], game: Game, reading: Reading
) -> tuple[Critic, ...] | None:
    """Return the critics of a history, one for each time, or None if the file is not a history.

    A file is not a history if each of its arrays W, P and K has the shape of a single critic.

    entries: entries of the file, including "time"
    game: the game whose states and inputs the critics use
    reading: options for the file

    Raises BadInputError if the basis in `reading` is a list of functions, if an array has a wrong
    shape, or under the conditions of `critics_over_time` and `file_scales`.
    """
    if is_list(reading.basis or ""):
        raise BadInputError(
            "--basis lists functions, but W is a history over time; give the name of a basis"
        )
    times = np.ravel(numbers_in("time", entries["time"]))
    n, m = game.B.shape
    psi = named_basis(reading.basis or "quadratic", n)
    sizes = {"W": (psi.size,), "P": (n, n), "K": (m, n)}
    rows = {
        name: _stacked(name, entries[name], len(times), size, psi)
        for name, size in sizes.items()
        if name in entries
    }
    if all(array.shape == sizes[name] for name, array in rows.items()):
        return None
    rows = in_plant_units(rows, file_scales(entries, game.names), psi)
    return critics_over_time(game, times, psi.name, **rows)


def _stacked(name: str, value: Any, count: int, size: tuple[int, ...], psi: Basis) -> np.ndarray:
    """Return W, P or K of a file with the times along the first axis."""
    array = numbers_in(name, value)
    if array.shape in ((count, *size), size):
        return array
    if len(size) == 2 and array.shape == (*size, count):
        return np.moveaxis(array, -1, 0)
    if array.shape == (count, math.prod(size)):
        return array.reshape(count, *size)
    reason = f"give {shape_text((count, *size))} for {count} times"
    if name == "W":
        reason += f", because basis {psi.name!r} of {psi.states} states has {psi.size} functions"
    raise BadInputError(f"{name} is {shape_text(array.shape)}; {reason}")
