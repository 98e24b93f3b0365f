"""Requests: the input of a run. A request has an aircraft, a trim, a game and an output.

Each command has a class of requests. The parser converts a command line to a request.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, TypeVar

from hfa.options.aircraft import Aircraft
from hfa.options.output import Output
from hfa.options.part import Option, Part, option, part
from hfa_support.errors import NoSolutionError, printable
from hfa_support.progress import print_to_stderr

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa.options.game import GameGiven
    from hfa.options.trim import Trim
    from hfa_aircraft.model import Model
    from hfa_support.provenance import Provenance
    from hfa_support.reporting.report import Report
    from hfa_support.reporting.results import Result


@dataclass(frozen=True, kw_only=True, eq=False)
class Request(Part):
    """Input of one run.

    aircraft, trim, game: what the run is about, or None
    output: where its report goes
    line: the command line as typed
    date: start of the run in UTC, as text
    quiet: whether notes and progress are suppressed
    """

    aircraft: Aircraft | None = None
    trim: Trim | None = None
    game: GameGiven | None = None
    output: Output = part(Output)
    quiet: bool = option("suppress notes and progress messages", names="-q --quiet", rare=True)
    line: str = ""
    date: str = ""

    @classmethod
    @cache
    def declared(cls) -> Mapping[str, Option]:
        """Return the options of the request, path of the field -> option.

        The parts come first, then the output and --quiet, then the options of the command itself.
        """
        last = {each.name for each in fields(Request)} - {"aircraft", "trim", "game"}
        found = super().declared()

        def place(path: str) -> int:
            if path.partition(".")[0] in last:
                return 1
            return 0 if "." in path else 2

        return {path: found[path] for path in sorted(found, key=place)}

    @classmethod
    def options(cls, model: Model) -> dict[str, Option]:
        """Return the options of the request in the names and units of a model, path -> option."""
        return {path: option.of(model, path) for path, option in cls.declared().items()}

    @classmethod
    def parsed(
        cls, model: Model, values: Mapping[str, Any], *, line: str = "", date: str = ""
    ) -> Self:
        """Return the request with the values of the options that the user gave.

        values: path of the field -> value
        """
        options = cls.options(model)
        flags = {path: options[path].flags[-1] for path in values}
        return cls.of(model, values, flags, line=line, date=date)

    @classmethod
    def of_the_model(cls) -> type[Aircraft]:
        """Return the class of the aircraft, which defines the model."""
        declared = cls.__dataclass_fields__["aircraft"].metadata.get("part")
        return Aircraft if declared is None else declared.kind

    @cached_property
    def provenance(self) -> Provenance:
        """Provenance of the run, which is written into its outputs."""
        from hfa_support.provenance import Provenance

        return Provenance(self.line, date=self.date, **self.origin())

    def origin(self) -> Mapping[str, Any]:
        """Return the entries of the provenance on the plant: a plant file, or aircraft and trim."""
        if self.game is not None and self.game.plant is not None:
            return {"model": str(self.game.plant)}
        if self.aircraft is None:
            return {}
        if self.trim is None:
            return self.aircraft.origin({})
        return self.aircraft.origin(self.trim.held_parameters) | self.trim.origin()

    def stated(self, report: Report) -> Report:
        """Return the report with the provenance of the run and the unit system of --units."""
        if "aircraft.units" in type(self).declared() and self.aircraft is not None:
            report = report.with_data(units=self.aircraft.units)
        origin = self.provenance
        return replace(report, source=origin.text()).with_data(provenance=origin)

    def show(
        self,
        report: Report,
        *,
        figure: Callable[[], Figure] | None = None,
        printed: Report | None = None,
        only_in_files: Result | Mapping[str, Any] | None = None,
        write: Callable[[Path], object] | None = None,
        notes: Iterable[str] = (),
    ) -> None:
        """Write the files of -o and --picture, then print the report, with the run's provenance.

        Notes are printed after the report.

        report: the report
        figure: function that draws the picture, or None if there is none
        printed: shorter report to print in place of `report`, or None
        only_in_files: result or entries added to the file of -o only, or None
        write: function that writes the file of -o in a format of the command's own, or None
        notes: notes on the result

        Raises NoSolutionError with `report.failure` if this text is not empty.
        """
        file = self.output.file
        picture = None if figure is None else self.output.picture
        if file is not None and write is not None:
            write(file)
        elif file is not None:
            self.stated(report).with_data(only_in_files or {}).save(file)
        if picture is not None and figure is not None:
            from hfa_support.reporting.figure import save

            save(figure(), picture, self.provenance.text())
        self.print(printed or report, notes=notes)
        for written in filter(None, (file, picture)):
            print_to_stderr(f"wrote {printable(written)}")
        if report.failure:
            raise NoSolutionError(report.failure)

    def print(self, report: Report, *, notes: Iterable[str] = ()) -> None:
        """Print a report with the provenance of the run, and write no file."""
        self.output.print(self.stated(report), notes=notes)


class Command(NamedTuple):
    """A command of `hfa`.

    request: class whose fields are the options
    run: function that maps a request to the exit code, with the help as its docstring
    install: optional packages that the command requires, as pip names them
    example: last line of the help
    """

    request: type[Request]
    run: Callable[[Any], int]
    install: tuple[str, ...] = ()
    example: str = ""


R = TypeVar("R", bound=Request)


def command(request: type[R]) -> Callable[[Callable[[R], int]], Command]:
    """Return a decorator that makes a `Command` from a function (request) -> exit code.

    request: class of the requests, whose fields are the options
    """
    return lambda run: Command(request, run)
