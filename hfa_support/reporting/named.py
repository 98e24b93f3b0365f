"""Tuples that can be indexed by the names of their entries."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from itertools import chain, product
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from hfa_support.errors import BadInputError, imported, refuse_unknown

if TYPE_CHECKING:
    import pandas


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

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        """Return a computed array, or a number instead of an array without axes."""
        return array[()] if array.ndim == 0 else super().__array_wrap__(array, context)

    def _ipython_key_completions_(self) -> list[Any]:
        """Return what IPython offers after A[: names, or tuples of names of several axes."""
        named = [names for names in self.names if names]
        return list(product(*named)) if len(named) > 1 else [*chain(*named)]

    def __repr__(self) -> str:
        return repr(np.asarray(self))

    def __reduce__(self) -> Any:
        return with_names, (np.asarray(self), *self.names)

    def __copy__(self) -> NamedArray:
        return with_names(np.array(self), *self.names)

    def __deepcopy__(self, _: Any) -> NamedArray:
        return self.__copy__()


def with_names(values: np.ndarray, *names: tuple[str, ...]) -> NamedArray:
    """Return a view of an array, with names for the entries of each axis.

    names: a tuple for each axis, () for an axis without names
    """
    named = values.view(NamedArray)
    named.names = names
    return named


Named = TypeVar("Named", covariant=True)


class ByName(tuple[Named, ...]):
    """Tuple whose entries are found by number or by their `name`, as in modes["phugoid"].

    lacking: name of a missing entry -> why it is missing
    """

    lacking: Mapping[str, str] = MappingProxyType({})

    def __getitem__(self, index: Any) -> Any:
        """Return the entry with this number or name. Raises BadInputError for an unknown name."""
        if not isinstance(index, str):
            return super().__getitem__(index)
        if index in self.lacking:
            raise BadInputError(f"there is no {index}: {self.lacking[index]}")
        refuse_unknown("unknown name", index, self.keys())
        return self[self.keys().index(index)]

    def keys(self) -> list[str]:
        """Return the names of the entries.

        Because of this method, dict(modes) is a dictionary from names to entries.
        """
        return [entry.name for entry in self]  # type: ignore[attr-defined]  # entries have names

    def _ipython_key_completions_(self) -> list[str]:
        return self.keys()

    def values(self) -> Any:
        """Return this tuple, as the entries of a mapping."""
        return self

    def items(self) -> Any:
        """Return the pairs (name, entry), as the view of a dictionary."""
        return dict(self).items()

    def to_pandas(self) -> pandas.DataFrame:
        """Return a `pandas.DataFrame` with one row for each entry, indexed by its name."""
        pandas = imported("pandas", "data frames require")
        rows = []
        for entry in self:
            fields = entry._asdict() if hasattr(entry, "_asdict") else vars(entry)
            rows.append({n: value for n, value in fields.items() if not isinstance(value, dict)})
        return pandas.DataFrame(rows).set_index("name")

    def _repr_html_(self) -> str | None:
        """Return a table for notebooks, or None without entries or without pandas."""
        if not self or find_spec("pandas") is None:
            return None
        return str(self.to_pandas().to_html())
