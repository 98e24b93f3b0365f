"""Tuples of what has a name."""

from __future__ import annotations

from typing import Any, TypeVar

from hfa_support.errors import refuse_unknown

Named = TypeVar("Named", covariant=True)


class ByName(tuple[Named, ...]):
    """A tuple whose entries have a `name`, which indexes them too: modes["phugoid"]."""

    def __getitem__(self, index: Any) -> Any:
        """The entry of a number or a name. BadInputError for an unknown name."""
        if not isinstance(index, str):
            return super().__getitem__(index)
        by_name = {entry.name: entry for entry in self}  # type: ignore[attr-defined]
        refuse_unknown("unknown name", index, by_name)
        return by_name[index]
