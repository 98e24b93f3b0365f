"""Optional data of a model, set by readers of files and by the paper's aircraft."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from hfa_support.reporting.report import Report


@dataclass(frozen=True, eq=False)
class Extras:
    """Names, validity, trim advice and origin of a model. A user's declaration has none.

    called: name in reports, or "" for the name of the model
    names_schedule: whether options and data use the name of the scheduling variable (--dihedral,
        dihedral_deg) in place of --at and scheduled
    aliases: name in another program -> name here
    notes: sentences for every report
    parts: ending -> linear states. OUTPUT_ending names the part of an output caused by these
        states, the inputs and the disturbances, for controllers.
    variants: names of its other equations, which a design may treat differently

    range: state -> (largest absolute value, source). Larger values give a warning.
    envelope: function (x, p) of a trim -> limits of the states in flights about it, state ->
        (lowest, highest), where they differ from min and max. x and p are by name.
    check: function that raises BadInputError for a state, by name, outside the domain of the
        equations

    alternatives: groups of names of which a trim imposes one. Imposing another name of the group
        sets it free.
    begin: imposed values by name, numbers or arrays -> initial values of the search for the others.
        The value of the first name of a group of alternatives is exact.
    explain: (imposed values, solve) -> reason why no trim exists, in terms of the aircraft
        (`trim.point.reasons`)
    describe_trim: (operating point, its report) -> the report with the aircraft's own description
        of the trim in place of its outputs

    source: file and name that the model was loaded from, and a hash
    native: the model that `hfa_aircraft.units.in_si` converted into this one
    made_by: function that makes the model in another process from `native`, or from `source` and
        the parameters. With None the model itself is sent.
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
