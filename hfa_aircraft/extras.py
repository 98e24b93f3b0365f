"""Additions of a reader of files, or of the paper's aircraft, to a model's declaration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from hfa_support.reporting.report import Report


@dataclass(frozen=True, eq=False)
class Extras:
    """Names, validity, hints of the trim and origin of a model; a user's declaration has none.

    called: how reports name it; its name unless given.
    names_schedule: whether options and data call the scheduling variable by its own name,
        --dihedral and dihedral_deg, and not --at and scheduled.
    aliases: name in another program -> name here.
    notes: sentences for every report.
    parts: ending -> linear states. OUTPUT_ending names the part of an output that these states, the
        inputs and the disturbances cause, for controllers.
    variants: names of its other equations, which a design may treat differently.

    range: state -> (largest absolute value, whose). Beyond it models come with a warning.
    envelope: (x, p) of a trim, by name -> limits of the states that a flight about it keeps where
        they are not min and max: state -> (lowest, highest).
    check: raises BadInputError for a state, by name, where the equations mean nothing whatever the
        limits.

    alternatives: groups of names of which a trim imposes one: to impose another sets it free.
    begin: imposed values by name, numbers or arrays -> where a search for others begins. The value
        of the first of a group of alternatives is exact.
    explain: (imposed values, solve) -> why there is no trim, in the words of its field
        (`trim.point.reasons`).
    describe_trim: (operating point, report of it) -> the report with what this aircraft says of a
        trim in place of its outputs.

    source: the file and name that it was loaded from, and a hash.
    native: the model that `hfa_aircraft.units.in_si` converted into this one.
    made_by: what makes it again in another process: of `native`, else of `source` and the values of
        the parameters, or None where it is sent as it is.
    """

    called: str = ""
    names_schedule: bool = False
    aliases: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    parts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    variants: tuple[str, ...] = ()
    range: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    envelope: Callable[[Any, Any], Mapping[str, tuple[float, float]]] | None = None
    check: Callable[[Any], None] | None = None
    alternatives: tuple[tuple[str, ...], ...] = ()
    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    explain: Callable[[Mapping[str, float], Callable[..., Any]], str] | None = None
    describe_trim: Callable[[Any, Report], Report] | None = None
    source: tuple[str, str] = ("", "")
    native: Model | None = None
    made_by: Callable[..., Model] | None = None
