"""Tuples of what has a name, and arrays whose columns have one."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np

from hfa_support.errors import refuse_unknown

Named = TypeVar("Named", covariant=True)


class ByName(tuple[Named, ...]):
    """A tuple whose entries have a `name`, which indexes them too: modes["phugoid"]."""

    def __getitem__(self, index: Any) -> Any:
        """The entry of a number or a name. Raises BadInputError for an unknown name."""
        if not isinstance(index, str):
            return super().__getitem__(index)
        refuse_unknown("unknown name", index, self.keys())
        return self[self.keys().index(index)]

    def keys(self) -> list[str]:
        """The names, so that dict(modes) is a dictionary of the entries."""
        return [entry.name for entry in self]  # type: ignore[attr-defined]

    def values(self) -> Any:
        """The entries."""
        return self

    def items(self) -> Any:
        """The pairs (name, entry)."""
        return dict(self).items()


class Columns(np.ndarray):
    """An array (N, n) whose columns have names, which index them too: states["alpha"], (N,)."""

    names: tuple[str, ...] = ()

    def __getitem__(self, index: Any) -> Any:
        """A column by its name, or as of a plain array. Raises BadInputError for another name."""
        values = np.asarray(self)
        if not isinstance(index, str):
            return values[index]
        refuse_unknown("unknown name", index, self.names)
        return values[:, self.names.index(index)]

    def __reduce__(self) -> Any:
        return with_names, (np.asarray(self), self.names)


def with_names(values: np.ndarray, names: tuple[str, ...]) -> Columns:
    """The array with names of its columns."""
    columns = values.view(Columns)
    columns.names = names
    return columns
