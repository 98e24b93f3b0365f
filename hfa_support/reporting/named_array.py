"""Arrays that can be indexed by the names of their entries."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_support.errors import refuse_unknown


class NamedArray(np.ndarray):
    """Array with names for the entries of each axis.

    names: for each axis, the names of its entries, or () for an axis without names

    Names index the last axes. For example, states["alpha"] of states (N, n) has the shape (N,), and
    A["pitch_rate", "alpha"] is a number.
    """

    names: tuple[tuple[str, ...], ...] = ()

    def __getitem__(self, index: Any) -> Any:
        """Return entries by name, or by any index of a NumPy array.

        Raises BadInputError for an unknown name.
        """
        values = np.asarray(self)
        keys = index if isinstance(index, tuple) else (index,)
        if str not in map(type, keys):
            return values[index]
        numbers = []
        for key, names in zip(keys, self.names[-len(keys) :], strict=True):
            if isinstance(key, str):
                refuse_unknown("unknown name", key, names)
                key = names.index(key)
            numbers.append(key)
        return values[..., *numbers][()]  # converts an array without axes to a number

    def __repr__(self) -> str:
        return repr(np.asarray(self))

    def __reduce__(self) -> Any:
        return with_names, (np.asarray(self), *self.names)


def with_names(values: np.ndarray, *names: tuple[str, ...]) -> NamedArray:
    """Return a view of an array, with names for the entries of each axis.

    names: a tuple for each axis, () for an axis without names
    """
    named = values.view(NamedArray)
    named.names = names
    return named
