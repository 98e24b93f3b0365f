"""What a model says about itself: its names, its domain, its trims and its source."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from hfa_support.public_arguments import Declared

if TYPE_CHECKING:
    from hfa_support.reporting.rows import Row


@dataclass(frozen=True, eq=False)
class About(Declared):
    """Texts and names of a model in reports, options and files.

    title: name in reports, or "" for the name of the model
    subject: short name in the first lines of reports, or "" for the title
    notes: sentences for every report
    warnings: sentences on data that are probably wrong, below the first line of reports of trims
    warnings_about: function of the parameters, name -> value in declared units, that returns more
        such sentences; None for none
    aliases: name in another program -> name in the model
    names_schedule: whether options and data contain the name of the scheduling variable
        (--dihedral, dihedral_deg) instead of --at and scheduled
    equations: short name of the equations in the first lines of reports, unless `subject` has it
    atmosphere: name of the standard atmosphere of the equations, or ""
    trained_at: value of the scheduling variable at which environments begin, or None for the
        default trim
    configuration: function (x, u, p) of arrays -> name -> (value, unit) of mass, center of gravity,
        inertias and sizes, and words on flap and gear (`trim.reports.warnings`); None if only
        signals have them
    weights: default cost, {} without one. Of the file of a linear plant "Q", "R" and "N" as they
        are stored, for states and inputs divided by their nominal values. Of other models "Q" and
        "R" as signal -> weight on the diagonal, "delta", and "E", the states that are disturbed;
        all in the declared units
    weights_source: where `weights` are from, in reports
    sensors: table of sensors, the state or output that each measures -> "noise", "bias" and "every"
        -> text with a unit, as in a file of `--sensors`
    sensors_source: where `sensors` are from, in reports
    fault: function that returns why the last evaluation of a compiled program failed, or "". None
        for equations
    """

    title: str = ""
    subject: str = ""
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    warnings_about: Callable[[Mapping[str, float]], Iterable[str]] | None = None
    aliases: Mapping[str, str] = field(default_factory=dict)
    names_schedule: bool = False
    equations: str = ""
    atmosphere: str = ""
    trained_at: float | None = None
    configuration: Callable[[Any, Any, Any], Mapping[str, tuple[float | str, str]]] | None = None
    weights: Mapping[str, Any] = field(default_factory=dict)
    weights_source: str = "file"
    sensors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    sensors_source: str = ""
    fault: Callable[[], str] | None = None

    def name_of(self, typed: str) -> str:
        """Return the name in the model of a typed name, which may be one of `aliases`."""
        return self.aliases.get(typed, typed)

    def failed(self) -> str:
        """Return why the last evaluation of a compiled program failed (`fault`), or ""."""
        return "" if self.fault is None else self.fault()


@dataclass(frozen=True, eq=False)
class Domain(Declared):
    """States at which the equations of a model are valid, beside the limits of its signals.

    range: state, input or output -> (lowest, highest, source of this range). Values beyond the
        range cause a warning.
    envelope: function (x, p) of a trim -> limits of the states in flight, as state -> (lowest,
        highest), if they differ from min and max. x and p have fields by name.
    check: function of a state x, with fields by name, that raises BadInputError outside the domain
    reference: state or output -> its value at the condition of the derivatives of a linear table
    by_speed: entries of this table that state an effect of the speed near that of `reference`
    flown: function (X, U, p) of the states (N, n), inputs (N, m) and parameters of a flight -> why
        the equations are not valid in it, or ""
    """

    range: Mapping[str, tuple[float, float, str]] = field(default_factory=dict)
    envelope: Callable[[Any, Any], Mapping[str, tuple[float, float]]] | None = None
    check: Callable[[Any], None] | None = None
    reference: Mapping[str, float] = field(default_factory=dict)
    by_speed: tuple[str, ...] = ()
    flown: Callable[[Any, Any, Any], str] | None = None


@dataclass(frozen=True, eq=False)
class Trimming(Declared):
    """What a model knows about its own trims.

    alternatives: groups of names, of which a trim imposes one, beside speed and airspeeds. Imposing
        another name of the group frees the imposed one.
    begin: function (imposed values by name) -> initial values of the other variables in a trim
        search. Values are numbers or arrays. None for the declared initial values, and in turns
        those of `hfa_aircraft.signals.usual_begin`.
    describe: function (operating point) -> further groups of its sheet, (title, rows, sentences)
        each; None for none
    """

    alternatives: tuple[tuple[str, ...], ...] = ()
    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]] | None = None
    describe: Callable[[Any], Sequence[tuple[str, Sequence[Row], Sequence[str]]]] | None = None

    def initial(self, imposed: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the initial values that `begin` computes, variable -> number or array.

        imposed: name -> imposed value or parameter
        """
        return {} if self.begin is None else self.begin(imposed)


@dataclass(frozen=True, eq=False)
class Source(Declared):
    """The file of a model, and how another process makes the model again.

    text: argument of --aircraft from which the model was loaded, or ""
    digest: hash of the files, or ""
    declared: parameter -> value before it was changed, for parameters that were changed
    native: `Model` that `hfa_aircraft.units.in_si` converted to this one, or None
    reload: function that makes the model again, from `native`, or from text, digest and parameters
        (name -> value). None for a model that is pickled.
    """

    text: str = ""
    digest: str = ""
    declared: Mapping[str, float] = field(default_factory=dict)
    native: Any = None
    reload: Callable[..., Any] | None = None

    def reduced(self, parameters: Mapping[str, float]) -> tuple[Any, ...]:
        """Return `reload` and its arguments, for pickle.

        A converted model is converted again. Another one is loaded again from its file.

        parameters: name -> value
        """
        if self.native is not None:
            return self.reload, (self.native,)
        return self.reload, (self.text, self.digest, parameters)
