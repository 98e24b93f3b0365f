"""Tuples whose entries have names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

from hfa_support.errors import refuse_unknown

Named = TypeVar("Named", covariant=True)


class ByName(tuple[Named, ...]):
    """Tuple indexed by number or by the `name` of an entry: modes["phugoid"]."""

    def __getitem__(self, index: Any) -> Any:
        """Return the entry at a number or with a name. Raises BadInputError for an unknown name."""
        if not isinstance(index, str):
            return super().__getitem__(index)
        refuse_unknown("unknown name", index, self.keys())
        return self[self.keys().index(index)]

    def __call__(self) -> ByName[Named]:
        """Return the tuple, so that modes() is modes."""
        return self

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Return an attribute that a package adds: modes.damping, modes.to_pandas()."""
            if name[0] == "_":
                raise AttributeError(name)
            from hfa_support.unknown import attribute_of

            return attribute_of(self, name)

    def keys(self) -> list[str]:
        """Return the names, so that dict(modes) is a dictionary of the entries."""
        return [entry.name for entry in self]  # type: ignore[attr-defined]

    def values(self) -> Any:
        """Return the entries."""
        return self

    def items(self) -> Any:
        """Return the pairs (name, entry)."""
        return dict(self).items()
