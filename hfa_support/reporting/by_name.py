"""Tuples that can be indexed by the names of their entries."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from hfa_support.errors import refuse_unknown

Named = TypeVar("Named", covariant=True)


class ByName(tuple[Named, ...]):
    """Tuple whose entries are found by number or by their `name`, as in modes["phugoid"]."""

    def __getitem__(self, index: Any) -> Any:
        """Return the entry with this number or name. Raises BadInputError for an unknown name."""
        if not isinstance(index, str):
            return super().__getitem__(index)
        refuse_unknown("unknown name", index, self.keys())
        return self[self.keys().index(index)]

    def __call__(self) -> ByName[Named]:
        """Return this tuple: modes() is modes."""
        return self

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return an attribute that an extension adds, for example modes.damping."""
            if name.startswith("__"):
                raise AttributeError(name)
            from hfa_support.unknown import attribute_of

            return attribute_of(self, name)

    def keys(self) -> list[str]:
        """Return the names of the entries.

        Because of this method, dict(modes) is a dictionary from names to entries.
        """
        return [entry.name for entry in self]  # type: ignore[attr-defined]

    def values(self) -> Any:
        """Return this tuple, as the entries of a mapping."""
        return self

    def items(self) -> Any:
        """Return the pairs (name, entry), as the view of a dictionary."""
        return dict(self).items()
