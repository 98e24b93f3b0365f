"""Where a model comes from, and what reports call it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, eq=False)
class About:
    """Texts and names of a model in reports, options and files.

    title: name in reports, or "" for the name of the model
    notes: sentences for every report
    aliases: name in another program -> name in the model
    names_schedule: whether options and data contain the name of the scheduling variable
        (--dihedral, dihedral_deg) instead of --at and scheduled
    variants: names of other equations, which a design may treat differently
    """

    title: str = ""
    notes: tuple[str, ...] = ()
    aliases: Mapping[str, str] = field(default_factory=dict)
    names_schedule: bool = False
    variants: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Source:
    """The file of a model, and how another process makes the model again.

    text: argument of --aircraft from which the model was loaded, or ""
    digest: hash of the files, or ""
    native: `Model` that `hfa_aircraft.units.in_si` converted to this one, or None
    reload: function that makes the model again, from `native`, or from text, digest and parameters
        (name -> value). None for a model that is pickled.
    """

    text: str = ""
    digest: str = ""
    native: Any = None
    reload: Callable[..., Any] | None = None

    def reduced(self, parameters: Mapping[str, float]) -> tuple[Any, ...]:
        """Return `reload` and its arguments, for pickle.

        parameters: name -> value
        """
        if self.native is not None:
            return self.reload, (self.native,)
        return self.reload, (self.text, self.digest, parameters)
