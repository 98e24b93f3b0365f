"""What a command prints, writes, draws and says aside, each with where it comes from."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from hfa_support.errors import on_one_line
from hfa_support.progress import say, say_aside

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_aircraft.model import Model
    from hfa_model.provenance import Provenance
    from hfa_support.reporting.report import Report
    from trim.point.operating_point import OperatingPoint

# Provenance.


def provenance(arguments: argparse.Namespace) -> Provenance:
    """Of a run with these options: the program, the aircraft, the condition of its trims."""
    from hfa.options import trims
    from hfa_model.provenance import Provenance, changed_parameters, parameter_hash

    line = arguments.line
    if getattr(arguments, "model", None) is not None:
        return Provenance(line, model=str(arguments.model))
    if not hasattr(arguments, "parameters"):
        return Provenance(line)
    flights = trims.flights_of(arguments) if hasattr(arguments, "start") else None
    condition: dict[str, Any] = flights.to_dict() if flights else {}
    if (own := getattr(arguments, "aircraft", None)) is not None:
        condition["parameters"] = trims.held_parameters(arguments)
        return Provenance(
            line, model=f"{own.source[0]} (SHA-256 {own.source[1][:12]})", condition=condition
        )
    if flights is not None and isinstance(arguments.at, float):
        single = flights.at(arguments.at)
        limits = {name: list(single.limits_of(name)) for name in single.free}
        condition = {"imposed": dict(single.imposed), "free": list(single.free), "limits": limits}
    chosen, dynamics = trims.parameters_of(arguments), getattr(arguments, "dynamics", "both")
    changed = dict(changed_parameters(chosen))
    if dynamics == "unsteady" and flights is not None:
        from hfa_model.unsteady import UNSTEADY

        held = trims.held_parameters(arguments)
        changed |= {name: (value, UNSTEADY.parameters[name].start) for name, value in held.items()}
    flight = flights.in_words() if flights else ""
    return Provenance(
        line, dynamics, chosen.name, parameter_hash(chosen.values), changed, condition, flight
    )


def origin_lines(arguments: argparse.Namespace) -> str:
    """The provenance of the run and its command, for the top of a source file."""
    return f"{provenance(arguments).text()}\n{arguments.line}"


# Results.


def stated(report: Report, arguments: argparse.Namespace) -> Report:
    """The report in the units that --units names, where the command has it, with the provenance of
    the run as its last line and in its data."""
    if hasattr(arguments, "units"):
        report = report.with_data(units=arguments.units)
        if arguments.units == "si":
            from hfa.options.argument_types import model
            from hfa.units_of_data import in_si

            report = in_si(report, model())
    origin = provenance(arguments)
    return replace(report, source=origin.text()).with_data(provenance=origin.to_dict())


def show(
    report: Report,
    arguments: argparse.Namespace,
    *,
    written: bool = False,
    only_in_files: Mapping[str, Any] | None = None,
    notes: Iterable[str] = (),
    points: Iterable[OperatingPoint] = (),
) -> None:
    """Write the file of -o, unless the command has `written` it; print the report or, with --json,
    its data; then the notes.

    only_in_files: data that would drown the rest on a terminal. points: trims whose warnings are
    data and notes too."""
    from hfa.options.trims import REPORTS
    from hfa_support.files import write_text

    if points:
        notes = list(dict.fromkeys(warning for point in points for warning in point.warnings))
        report = report.with_data(warnings=notes)
    if not written and (target := arguments.output) is not None:
        whole = stated(report.with_data(**(only_in_files or {})), arguments)
        if (form := REPORTS.get(target.suffix.lower())) is not None:
            write_text(target, form(whole))
        else:
            whole.save(target)
    report = stated(report, arguments)
    say(report.json() if arguments.json else report.text(_in_color()))
    say_notes(notes)


def _in_color() -> bool:
    """Whether output is a terminal whose user does not refuse colors (no-color.org)."""
    on_terminal = sys.stdout is not None and sys.stdout.isatty()
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return on_terminal and not plain


@contextmanager
def failure_as_data(arguments: argparse.Namespace, aircraft: Model) -> Iterator[None]:
    """With --json a trim that fails is printed as data too: the nearest point within the limits,
    which limits bind, and the reason."""
    from hfa.options.trims import condition_of
    from trim.hfa.hfa_report import trim_report
    from trim.point.solve import TrimError

    try:
        yield
    except TrimError as error:
        if arguments.json:
            report = trim_report(aircraft, condition_of(arguments), error.attempt)
            show(report.with_data(reason=str(error)), arguments, written=True)
        raise


def draw(arguments: argparse.Namespace, figure: Callable[[], Figure]) -> None:
    """Draw the figure into the file of --picture, if one was asked for."""
    if arguments.picture is not None:
        from hfa_support.reporting.figure import save

        save(figure(), arguments.picture, provenance(arguments).text())


# Standard error while a command works.


def say_notes(warnings: Iterable[str]) -> None:
    """What a user should know before trusting a result, on standard error, a line each."""
    for warning in warnings:
        say_aside(f"hfa: note: {on_one_line(warning)}")


#: Seconds: of work from which its length is estimated, and from which it is announced.
_TRIAL, _LONG = 3.0, 300.0


class ProgressLine:
    """A `Progress` in one line of standard error, only when that is a terminal; gone when all is
    done."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._first: tuple[float, float] | None = None
        self._announced = False
        self._shown = sys.stderr is not None and sys.stderr.isatty()
        self._last = ""

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """Show the percentage of `done` in `total`, and the current step."""
        self._announce(done, total)
        line = f"\r\033[K{self._name}: {int(100 * done / total):3d} %" + (
            f"  {what}" if what else ""
        )
        if self._shown and line != self._last:
            self._last = line
            say_aside(line, end="\r\033[K" if done >= total else "")

    def _announce(self, done: float, total: float) -> None:
        """Say once, terminal or not, what will take long: by the pace of the first `_TRIAL`
        seconds."""
        now = time.monotonic()
        if self._first is None or done < self._first[1]:  # the first part, or the next of several
            self._first = now, done
        began, before = self._first
        if self._announced or now - began < _TRIAL or done <= before:
            return
        self._announced = True
        left = (now - began) * (total - done) / (done - before)
        if left > _LONG:
            say_notes([f"{self._name}: about {left / 60:.3g} minutes more; Ctrl-C ends it"])
