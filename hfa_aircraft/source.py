"""Optional data of a model, set by readers of aircraft files and by the HFA."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hfa_support.reporting.report import Report


@dataclass(frozen=True, eq=False)
class Extras:
    """Optional data of a model.

    called: name in reports, or "" for the name of the model
    names_schedule: whether options and data contain the name of the scheduling variable
        (--dihedral, dihedral_deg) instead of --at and scheduled
    aliases: name in another program -> name in the model
    notes: sentences for every report
    parts: suffix -> linear states. The measurable quantity OUTPUT_suffix is the part of an output
        that these states, the inputs and the disturbances cause.
    variants: names of other equations, which a design may treat differently

    range: state -> (largest absolute value, source). Larger values cause a warning.
    envelope: function (x, p) of a trim -> limits of the states in flight, as state -> (lowest,
        highest), if they differ from min and max. x and p have fields by name.
    check: function of a state x, with fields by name, that raises BadInputError outside the domain
        of the equations; None for no check

    alternatives: groups of names, of which a trim imposes one. Imposing another name of the group
        frees the imposed one.
    begin: function (imposed values by name) -> initial values of the other variables in a trim
        search. Values are numbers or arrays. The first name of a group of alternatives receives its
        exact value. None for the declared initial values.
    explain: function (imposed values, solve) -> reason why no trim exists, in terms of the aircraft
        (`trim.point.diagnosis`), or ""; None for no explanation
    describe_trim: function (operating point, its report) -> the report with the aircraft's own
        description of the trim in place of its outputs; None for the outputs

    source: file and name from which the model was loaded, and a hash
    native: `Model` that `hfa_aircraft.units.in_si` converted to this one, or None
    made_by: function that makes the `Model` in another process, from `native`, or from `source` and
        the parameters. Without such a function (None), the model is pickled.
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
    native: Any = None
    made_by: Callable[..., Any] | None = None
