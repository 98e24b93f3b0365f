"""Arrays with names along their axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from hfa_support.errors import refuse_unknown


class NamedArray(np.ndarray):
    """Array with names of the entries along each axis, () without names.

    Names index the last axes: states["alpha"] is (N,), A["pitch_rate", "alpha"] a number.
    """

    names: tuple[tuple[str, ...], ...] = ()

    def __getitem__(self, index: Any) -> Any:
        """Return entries by name, or index as a plain array does.

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
        entries = values[..., *numbers]
        return entries[()]  # a number in place of an array without axes

    def __repr__(self) -> str:
        return repr(np.asarray(self))

    def __reduce__(self) -> Any:
        return with_names, (np.asarray(self), *self.names)


def with_names(values: np.ndarray, *names: tuple[str, ...]) -> NamedArray:
    """Return the array with names of the entries along each axis, or ()."""
    named = values.view(NamedArray)
    named.names = names
    return named
